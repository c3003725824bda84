"""Recordings and certificates derived again, by code that shares nothing with the run."""
