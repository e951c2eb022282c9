"""HTML reports of a dataset, and of runs with their evaluation."""

from t2twin.core.cache_dir import configure_matplotlib_dir

configure_matplotlib_dir()
