"""The set-up page: the owner chooses camera and boards, calibrates, and opens the network."""
