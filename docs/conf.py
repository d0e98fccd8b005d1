"""How `make docs` builds the site of these pages. Every warning is an error there."""

project = "Holdfast"
project_copyright = "The Holdfast authors"
extensions = ["myst_parser"]
nitpicky = True
highlight_language = "none"

myst_heading_anchors = 4
suppress_warnings = ["misc.highlighting_failure"]  # the supervisor's diagram, which only GitHub draws

html_theme = "furo"
html_title = "Holdfast"
html_copy_source = False
html_show_sphinx = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}
