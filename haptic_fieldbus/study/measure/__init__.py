"""Numbers of the report: each module measures one thing and knows nothing of pages."""
