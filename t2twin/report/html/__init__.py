"""Building blocks of the pages: markup, style, labels and figures."""
