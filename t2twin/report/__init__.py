"""The report of a dataset, its trainings and its evaluation: one page that needs no other file."""

from t2twin.core.cache_dir import configure_matplotlib_dir

configure_matplotlib_dir()
