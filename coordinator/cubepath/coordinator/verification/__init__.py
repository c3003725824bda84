"""Recordings and certificates derived again, by code that shares nothing with the run.

From the coordinator it imports only `normal_form.definitions`, and from the agents nothing. This
holds for indirect imports too, so a bug in the run cannot hide here. From the core's actions it
takes `Action` and `commute`; it defines admissible itself. `runs` and `shortening` check their
results with it, and `auditing` asks the rules of a recording with it.
"""
