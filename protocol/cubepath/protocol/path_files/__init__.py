"""Files that hold paths: moves, cubes, schedules, timetables and certificates."""
