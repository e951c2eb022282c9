"""What a user of a page can change."""
