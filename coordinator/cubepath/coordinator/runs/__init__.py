"""Runs from launch to recording: gathering, schedules, replay, what a recording holds, pictures."""
