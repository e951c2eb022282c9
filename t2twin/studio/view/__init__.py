"""What a page shows: the scene and the cards."""
