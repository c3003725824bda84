"""Shortening itself: heaps of pieces, the normal cube path, its proof and its timetable.

It takes only actions: it knows no recording, no command and no kind of system. From the protocol it
imports `core` and the forms of `path_files`, from the coordinator nothing. Rooms that shorten
import it; `verification` imports only the self-contained `definitions`.
"""
