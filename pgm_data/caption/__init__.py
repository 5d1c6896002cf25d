"""Words about what each player does."""
