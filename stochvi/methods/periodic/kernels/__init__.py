"""The compiled code of periodic regimes.

`solver` holds rigid stops, `flow` stops of any law, springs and dampers that are functions, and
`flights` many starts at once.
"""
