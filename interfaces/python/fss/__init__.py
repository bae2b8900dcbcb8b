"""The front door for services in Python: see fss.service."""
