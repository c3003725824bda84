"""Proofs checked by code that shares nothing with what finds them."""
