"""Shortening itself: heaps of pieces, the normal cube path, its proof and its timetable.

It takes actions alone: it knows no recording, no command and no kind of system. From the protocol
it imports `core` and the formats of `path_files`, from the coordinator nothing. Rooms that shorten
import it; `verification` imports only the self-contained `definitions`.
"""
