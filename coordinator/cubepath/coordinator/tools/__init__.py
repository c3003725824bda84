"""Tools around a run: its page, a recorder from outside, diff, exports, cut recordings."""
