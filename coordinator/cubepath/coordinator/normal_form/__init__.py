"""Shortening itself: heaps of pieces, the normal cube path, its proof and its timetable."""
