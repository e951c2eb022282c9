"""Controls of a page: the press, files, frames to translate, and view options."""
