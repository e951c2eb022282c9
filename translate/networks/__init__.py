"""Networks of the translators."""
