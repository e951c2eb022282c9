"""The studio: press, look and translate in a browser. Its core knows no browser: `press_state`,
`session`, `translators`; `scene`, `controls`, `cards` and `page` are what one client sees."""
