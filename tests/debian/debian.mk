# SPDX-License-Identifier: Apache-2.0
# The README's commands on a clean Debian, in a folder: DEBIAN=12 or 13; both when it is empty.

DEBIAN ?= 12 13

.PHONY: test-debian
test-debian: $(call apt,clean) ## build, install, pair and open the page on a clean Debian, in build/debian; DEBIAN=12 or 13, otherwise both
	@$(PYTHON) tests/debian/run.py --out $(BUILD)/debian $(DEBIAN)

# BUILT=1: with the packages that are there already.
BUILT ?=
.PHONY: test-deb
test-deb: $(call apt,clean) $(call apt,apt-repo) ## build Debian packages in a clean Debian, then install, use, upgrade, remove and purge them in another, as root; DEBIAN=12 or 13, otherwise both; BUILT=1: those of build/deb
	@$(if $(BUILT),,$(foreach r,$(DEBIAN),$(MAKE) deb RELEASE=$(r) &&) true)
	@/usr/bin/python3 tests/debian/packages.py --packages $(DEB) --out $(BUILD)/test-deb $(DEBIAN)
