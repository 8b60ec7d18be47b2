"""What each protocol makes of a plan: mapped signals, layout, traffic."""
