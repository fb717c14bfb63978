# SPDX-License-Identifier: Apache-2.0
# Debian packages, and a repository of them for apt.

# RELEASE: 12 or 13, built in a clean root of it; empty: on this machine.
RELEASE ?=
DEB := $(BUILD)/deb

.PHONY: deb
deb: $(if $(RELEASE),$(call apt,clean),$(call apt,build) $(call apt,firmware) $(call apt,deb)) ## build Debian packages in build/deb; RELEASE=12 or 13 in a clean root of it, as root
	@/usr/bin/python3 packaging/deb/build.py --out $(DEB) $(if $(RELEASE),--release $(RELEASE))

# KEY: of gpg, that signs.
KEY ?=
.PHONY: apt-repo
apt-repo: $(call apt,apt-repo) ## make a signed repository for apt in build/apt of the packages in build/deb: KEY=name or address of a gpg key
	@/usr/bin/python3 packaging/deb/repo.py --packages $(DEB) --out $(BUILD)/apt --key '$(KEY)'
