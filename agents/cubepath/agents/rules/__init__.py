"""Rules: what a module chooses from what it sees, built in or from other distributions."""
