"""A probe without a screen: one LED that says how it is, and one button (docs/users/panel.md)."""
