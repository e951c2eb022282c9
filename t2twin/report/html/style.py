"""CSS of the pages, with light and dark themes, for screens, phones and print."""

STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --soft: #444; --pale: #666; --paper: #fff;
  --line: #ccc; --thin: #e6e6e6; --strong: #999; --link: #0b5394; --card: #fff; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4e4e4; --soft: #bdbdbd; --pale: #a3a3a3; --paper: #17191c;
    --line: #45494f; --thin: #2f3338; --strong: #70757c; --link: #8ab8f0; --card: #f4f4f2; }
  img { padding: 0.4rem; border-radius: 0.4rem; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 66rem; padding: 1rem; color: var(--ink);
  background: var(--paper); overflow-wrap: anywhere;
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 1rem 0 0.5rem; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 0.5rem; border-bottom: 1px solid var(--line); }
p, li { max-width: 46rem; }
nav { font-size: 0.9rem; margin-top: 1.5rem; line-height: 1.9; }
nav a { margin-right: 0.9rem; color: var(--link); white-space: nowrap; }
.note, figcaption, .sideways { color: var(--soft); font-size: 0.88rem; }
.sideways { display: none; margin: 0.8rem 0 0; font-style: italic; }
figure { margin: 1rem 0; }
figcaption { max-width: 46rem; margin-top: 0.2rem; }
img { display: block; width: 100%; height: auto; background: var(--card); }
.small > img { max-width: 34rem; }
.wide { overflow-x: auto; }
.wide > img { min-width: 54rem; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(19rem, 100%), 1fr));
  gap: 0.5rem 1.2rem; }
.grid figure { margin: 0.4rem 0; }
.halves { grid-template-columns: repeat(auto-fit, minmax(min(25rem, 100%), 1fr)); }
table { border-collapse: collapse; font-size: 0.92rem; margin: 0.8rem 0; }
th, td { padding: 0.22rem 0.7rem; vertical-align: top; }
th { font-weight: 600; text-align: left; }
.facts td, .facts th { border-bottom: 1px solid var(--thin); }
.facts th { min-width: 7rem; overflow-wrap: normal; }
.figures { font-variant-numeric: tabular-nums; overflow-wrap: normal; }
.wide > .many { min-width: 54rem; }
.figures thead th { border-bottom: 1px solid var(--strong); text-align: right;
  vertical-align: bottom; }
.figures thead th:first-child { text-align: left; }
.figures thead tr:not(:last-child) th:empty { border-bottom: 0; }
.figures thead th[scope="colgroup"] { text-align: center;
  border-left: 1.2rem solid var(--paper); }
.figures tbody th { font-weight: 400; white-space: nowrap; }
.figures td { text-align: right; white-space: nowrap; border-bottom: 1px solid var(--thin); }
.figures tbody th { border-bottom: 1px solid var(--thin); }
.figures .span td, .figures .span th { color: var(--pale); font-size: 0.82rem; padding-top: 0; }
.figures tr:has(+ .span) > * { border-bottom: 0; padding-bottom: 0; }
.figures tr:not(.group) > th:first-child { position: sticky; left: 0; background: var(--paper); }
.figures .group th { font-weight: 600; padding-top: 0.7rem;
  border-bottom: 1px solid var(--strong); }
@media screen and (max-width: 56rem) { .sideways { display: block; } }
@media print {
  :root { --ink: #000; --soft: #333; --pale: #555; --paper: #fff; }
  body { max-width: none; font-size: 10pt; padding: 0; }
  nav { display: none; }
  .wide { overflow: visible; }
  .wide > img, .wide > .many { min-width: 0; }
  .grid { grid-template-columns: 1fr 1fr; }
  table { font-size: 8pt; }
  th, td { padding: 0.12rem 0.35rem; }
  figure, tr { break-inside: avoid; }
  h2 { break-after: avoid; }
}
"""
"""The complete CSS. Images keep a light background in the dark theme, as their colors require."""
