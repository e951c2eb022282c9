"""How far translators are from the truth, and what bounds them."""
