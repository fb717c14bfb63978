"""Networks of the probe itself: Wi-Fi, by NetworkManager. For the command and the set-up page."""
