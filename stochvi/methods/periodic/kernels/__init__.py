"""The compiled code of periodic regimes.

`solver` holds rigid stops, `contact_flow` compliant stops, `function_flow` springs and
dampers that are functions, and `flights` many starts at once.
"""
