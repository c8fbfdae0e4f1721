"""Recordings judged by themselves, before any model: which samples count, and why others do not."""
