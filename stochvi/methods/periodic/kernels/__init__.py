"""The compiled code of periodic regimes.

`solver` holds rigid stops, `contact_flow` compliant stops, `hertz_flow` what those of Hertz's
law add, and `flights` many starts at once.
"""
