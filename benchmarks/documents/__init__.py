"""The tables of README.md, CHANGELOG.md and docs/, written from the results and from the code."""
