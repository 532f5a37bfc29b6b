"""`stochvi explore`: a scene whose knobs are turned in the browser. `knobs` says what can be
turned, `turns` answers a turn in stages, and `server` serves the page on this machine alone."""
