"""What goes over zenoh: messages, key expressions and session settings."""
