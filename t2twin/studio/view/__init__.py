"""Output of a page: the scene, the cards and notices."""
