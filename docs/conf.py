"""Sphinx configuration: sphinx-build -W -b html docs target/docs-site"""

project = "evrig"
author = "The evrig authors"
extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "evrig"
html_copy_source = False
