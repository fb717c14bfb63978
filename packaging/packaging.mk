# SPDX-License-Identifier: Apache-2.0
# Packages of the operating system: one list per purpose in packaging/apt/.

# $(call apt,NAME): stamp that the packages of packaging/apt/NAME.txt are installed.
apt = $(STAMPS)/apt-$(1)

$(STAMPS)/apt-%: packaging/apt/%.txt packaging/apt-install
	@packaging/apt-install $<
	@mkdir -p $(@D) && touch $@

.PHONY: setup-build
setup-build: $(call apt,build) $(call apt,checks)

# Installing. DESTDIR: a folder that stands for /, when a package is made. What each Debian package has (make deb); all
# of them are what `make install` copies.
PACKAGED := lightprobed lightprobe lightprobe-dev
IN_lightprobed := install-daemon install-data
IN_lightprobe := install-python
IN_lightprobe-dev := install-dev
PREFIX ?= /usr/local
DESTDIR ?=
INSTALLED := bin/lightprobed bin/lightprobe lib/lightprobe lib/systemd/system/lightprobed.service lib/systemd/system/lightprobe-setup.service lib/systemd/system/lightprobe-panel.service \
	lib/sysusers.d/lightprobe.conf lib/udev/rules.d/70-lightprobe.rules lib/udev/rules.d/71-lightprobe-mcu.rules \
	lib/udev/rules.d/72-lightprobe-iio.rules share/lightprobe share/doc/lightprobe-dev
CONFIG := $(DESTDIR)/etc/lightprobe/lightprobed.conf

# $(call must_exist,FILE): nothing is built as root.
must_exist = test -e $(1) || \
	{ echo 'install: $(1) is missing: run make build as yourself, then make install as root' >&2; exit 1; }

.PHONY: install install-packages install-daemon install-command install-data install-python install-dev uninstall check-service
install: $(foreach p,$(PACKAGED),$(IN_$p)) ## copy all that follows to PREFIX=/usr/local, as root, after make build
	@echo 'install: done. Next: edit $(CONFIG), then: systemctl enable --now lightprobed (after an update: systemctl restart lightprobed)'

# For packaging/deb/rules: each package into a folder of its own.
install-packages:
	@$(foreach p,$(PACKAGED),$(MAKE) $(IN_$p) DESTDIR='$(or $(DESTDIR),$(error install-packages needs DESTDIR=FOLDER; to install here: make install))/$p' &&) true

install-daemon: ## install daemon, service, rules and camera files; an existing configuration stays
	@$(call must_exist,$(INSTALLED_DAEMON))
	@install -D -t '$(DESTDIR)$(PREFIX)/bin' $(INSTALLED_DAEMON)
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/lib/systemd/system' packaging/systemd/*.service
	@sed -i 's|=/usr/bin/|=$(PREFIX)/bin/|' '$(DESTDIR)$(PREFIX)'/lib/systemd/system/lightprobe*.service
	@install -D -m 644 packaging/systemd/lightprobe.sysusers '$(DESTDIR)$(PREFIX)/lib/sysusers.d/lightprobe.conf'
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/lib/udev/rules.d' packaging/udev/*.rules
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/lightprobe/drop-ins' packaging/systemd/drop-ins/*.conf
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/lightprobe/cameras' packaging/cameras/*.camera
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/lightprobe/avahi' packaging/avahi/lightprobe.service
	@install -D -t '$(DESTDIR)$(PREFIX)/share/lightprobe' packaging/system-reload
	@if [ -e '$(CONFIG)' ]; then \
		echo 'install: $(CONFIG) is kept; for new settings see packaging/systemd/lightprobed.conf'; \
	else \
		install -D -m 644 packaging/systemd/lightprobed.conf '$(CONFIG)'; \
		sed -i 's|=/usr/local/|=$(PREFIX)/|' '$(CONFIG)'; \
	fi
	@$(if $(DESTDIR),,packaging/system-reload)

# Laid out as build/ is: lightprobe.installation. The venv's Python finds its packages wherever the folder lies; only
# bin/lightprobe names the place. COMPILE=0: without Python's compiled files, which a package makes where it is installed.
# PROCESSOR=aarch64: for another processor, as in an image, with the Python there in INSTALLED_PYTHON and the daemon in
# INSTALLED_DAEMON; without the simulated microcontroller, a program of this one.
COMMAND_DIR := $(PREFIX)/lib/lightprobe
COMPILE ?= 1
PROCESSOR ?=
INSTALLED_PYTHON ?= $(VENV)/bin/python
INSTALLED_DAEMON ?= $(BUILD)/release/bin/lightprobed
install-command: install-python install-data ## install the command lightprobe (600 MB with what it needs), the viewer and the firmware

install-data: ## install the viewer and the firmware alone
	@$(call must_exist,$(BUILD)/web/index.html)
	@$(call must_exist,$(BUILD)/firmware/lightprobe-mcu.hex)
	@rm -rf '$(DESTDIR)$(COMMAND_DIR)/web' '$(DESTDIR)$(COMMAND_DIR)/firmware'
	@install -D -m 644 -t '$(DESTDIR)$(COMMAND_DIR)/web' $(BUILD)/web/*
	@install -D -m 644 -t '$(DESTDIR)$(COMMAND_DIR)/firmware' $(BUILD)/firmware/lightprobe-mcu.hex

# What venv writes about the place where it was made is not true of the place where it will lie.
install-python: ## install the command lightprobe with what it needs
	@$(call must_exist,$(VENV)/bin/lightprobe)
	@rm -rf '$(DESTDIR)$(COMMAND_DIR)/venv'
	@$(INSTALLED_PYTHON) -m venv --without-pip '$(DESTDIR)$(COMMAND_DIR)/venv'
	@sed -i '/^command = /d' '$(DESTDIR)$(COMMAND_DIR)/venv/pyvenv.cfg'
	@rm '$(DESTDIR)$(COMMAND_DIR)/venv/bin/'[Aa]ctivate*
	@$(VENV)/bin/python packaging/install-command "$$(echo '$(DESTDIR)$(COMMAND_DIR)'/venv/lib/python3.*/site-packages)" $(PROCESSOR)
	@$(if $(PROCESSOR),,install -t '$(DESTDIR)$(COMMAND_DIR)/venv/bin' $(BUILD)/firmware/lightprobe-mcu-host)
	@$(if $(filter 0,$(COMPILE)),,$(VENV)/bin/python -m compileall -q -j 0 -s '$(DESTDIR)' '$(DESTDIR)$(COMMAND_DIR)/venv/lib')
	@mkdir -p '$(DESTDIR)$(PREFIX)/bin'
	@printf '#!/bin/sh\nexec %s/venv/bin/python -P -m lightprobe "$$@"\n' '$(COMMAND_DIR)' >'$(DESTDIR)$(PREFIX)/bin/lightprobe'
	@chmod 755 '$(DESTDIR)$(PREFIX)/bin/lightprobe'

install-dev: ## install what a client in another language needs: schema, golden bytes, the pages of the contract
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/lightprobe/proto' proto/lightprobe.proto proto/ranges.toml
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/lightprobe/golden' proto/golden/*
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/doc/lightprobe-dev' docs/users/conventions.md docs/users/clients.md

uninstall: ## remove what make install has copied; the configuration stays
	@if [ -z '$(DESTDIR)' ] && [ -d /run/systemd/system ]; then systemctl disable --now lightprobed lightprobe-setup lightprobe-panel; fi
	@rm -rf $(INSTALLED:%='$(DESTDIR)$(PREFIX)'/%)
	@$(if $(DESTDIR),,packaging/system-reload)
	@echo 'uninstall: done; $(CONFIG) and drop-ins under /etc/systemd are kept'

check-service: ## print systemd's rating of the service's isolation, from 0 (best) to 10, and its reasons
	@systemd-analyze --no-pager security --offline=yes packaging/systemd/lightprobed.service
