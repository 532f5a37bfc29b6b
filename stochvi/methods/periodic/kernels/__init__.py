"""The compiled code of periodic regimes.

`solver` holds rigid stops, `contact_flow` stops that give way, `hertz_flow` what those of Hertz's
law add, and `flights` many starts at once.
"""
