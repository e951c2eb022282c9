"""Networks of the translators."""

from t2twin.translate.library_settings import configure_libraries

configure_libraries()
