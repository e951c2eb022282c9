"""HTML, colors and figures of the reports."""
