"""Who may: people, their sessions and tokens, what they said, and the audit of it all."""
