"""The report of a dataset, its trainings and its evaluation: one page that needs no other file."""

from t2twin.primitives_cad.cache_home import matplotlib_home

matplotlib_home()
