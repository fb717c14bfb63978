# SPDX-License-Identifier: Apache-2.0
# The README's commands on a clean Debian, in a folder: DEBIAN=12 or 13; both when it is empty.

DEBIAN ?= 12 13

.PHONY: test-debian
test-debian: $(call apt,clean) ## build, install, pair and open the page on a clean Debian, in build/debian; DEBIAN=12 or 13, otherwise both
	@$(PYTHON) tests/debian/run.py --out $(BUILD)/debian $(DEBIAN)
