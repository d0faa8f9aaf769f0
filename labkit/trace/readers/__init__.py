"""Recordings from files: each format has its reader, which repairs or rejects what is damaged and reports it."""
