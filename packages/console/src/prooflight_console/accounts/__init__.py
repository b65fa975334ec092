"""Accounts and access: people, their sessions and tokens, and the audit of all changes."""
