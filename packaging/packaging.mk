# SPDX-License-Identifier: Apache-2.0
# Packages of the operating system: one list per purpose in packaging/apt/.

# $(call apt,NAME): stamp that the packages of packaging/apt/NAME.txt are installed.
apt = $(STAMPS)/apt-$(1)

$(STAMPS)/apt-%: packaging/apt/%.txt packaging/apt-install
	@packaging/apt-install $<
	@mkdir -p $(@D) && touch $@

.PHONY: setup-build
setup-build: $(call apt,build)
