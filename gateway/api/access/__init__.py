"""Who may ask for what over the network (`roles.py`), and who did (`audit.py`)."""
