"""`ta2 policy run`: arguments in, a policy played or judged, figures out."""
