# SPDX-License-Identifier: Apache-2.0
# Packages of the operating system: one list per purpose in packaging/apt/.

# $(call apt,NAME): stamp that the packages of packaging/apt/NAME.txt are installed.
apt = $(STAMPS)/apt-$(1)

$(STAMPS)/apt-%: packaging/apt/%.txt packaging/apt-install
	@packaging/apt-install $<
	@mkdir -p $(@D) && touch $@

.PHONY: setup-build
setup-build: $(call apt,build)

# Installing. DESTDIR: a folder that stands for /, when a package is made.
PREFIX ?= /usr/local
DESTDIR ?=
INSTALLED := bin/lightprobed bin/lightprobe lib/lightprobe lib/systemd/system/lightprobed.service lib/sysusers.d/lightprobe.conf \
	lib/udev/rules.d/70-lightprobe.rules lib/udev/rules.d/71-lightprobe-mcu.rules \
	lib/udev/rules.d/72-lightprobe-iio.rules share/lightprobe
CONFIG := $(DESTDIR)/etc/lightprobe/lightprobed.conf

# $(call must_exist,FILE): nothing is built as root.
must_exist = test -e $(1) || \
	{ echo 'install: $(1) is missing: run make build as yourself, then make install as root' >&2; exit 1; }

.PHONY: install install-daemon install-command uninstall check-service
install: install-daemon install-command ## copy all that follows to PREFIX=/usr/local, as root, after make build
	@echo 'install: done. Next: edit $(CONFIG), then: systemctl enable --now lightprobed (after an update: systemctl restart lightprobed)'

install-daemon: ## install daemon, service, rules and camera files; an existing configuration stays
	@$(call must_exist,$(BUILD)/release/bin/lightprobed)
	@install -D -t '$(DESTDIR)$(PREFIX)/bin' $(BUILD)/release/bin/lightprobed
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/lib/systemd/system' packaging/systemd/lightprobed.service
	@sed -i 's|=/usr/bin/|=$(PREFIX)/bin/|' '$(DESTDIR)$(PREFIX)/lib/systemd/system/lightprobed.service'
	@install -D -m 644 packaging/systemd/lightprobe.sysusers '$(DESTDIR)$(PREFIX)/lib/sysusers.d/lightprobe.conf'
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/lib/udev/rules.d' packaging/udev/*.rules
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/lightprobe/drop-ins' packaging/systemd/drop-ins/*.conf
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/lightprobe/cameras' packaging/cameras/*.camera
	@install -D -m 644 -t '$(DESTDIR)$(PREFIX)/share/lightprobe/avahi' packaging/avahi/lightprobe.service
	@if [ -e '$(CONFIG)' ]; then \
		echo 'install: $(CONFIG) is kept; for new settings see packaging/systemd/lightprobed.conf'; \
	else \
		install -D -m 644 packaging/systemd/lightprobed.conf '$(CONFIG)'; \
		sed -i 's|=/usr/local/|=$(PREFIX)/|' '$(CONFIG)'; \
	fi
	@$(if $(DESTDIR),,packaging/system-reload)

# Laid out as build/ is: lightprobe.installation. The venv's Python finds its packages wherever the folder lies; only
# bin/lightprobe names the place.
COMMAND_DIR := $(PREFIX)/lib/lightprobe
install-command: ## install the command lightprobe (600 MB with what it needs), the viewer and the firmware
	@$(call must_exist,$(VENV)/bin/lightprobe)
	@$(call must_exist,$(BUILD)/web/index.html)
	@$(call must_exist,$(BUILD)/firmware/lightprobe-mcu.hex)
	@rm -rf '$(DESTDIR)$(COMMAND_DIR)'
	@$(VENV)/bin/python -m venv --without-pip '$(DESTDIR)$(COMMAND_DIR)/venv'
	@$(VENV)/bin/python packaging/install-command "$$(echo '$(DESTDIR)$(COMMAND_DIR)'/venv/lib/python3.*/site-packages)"
	@install -t '$(DESTDIR)$(COMMAND_DIR)/venv/bin' $(BUILD)/firmware/lightprobe-mcu-host
	@install -D -m 644 -t '$(DESTDIR)$(COMMAND_DIR)/web' $(BUILD)/web/*
	@install -D -m 644 -t '$(DESTDIR)$(COMMAND_DIR)/firmware' $(BUILD)/firmware/lightprobe-mcu.hex
	@mkdir -p '$(DESTDIR)$(PREFIX)/bin'
	@printf '#!/bin/sh\nexec %s/venv/bin/python -P -m lightprobe "$$@"\n' '$(COMMAND_DIR)' >'$(DESTDIR)$(PREFIX)/bin/lightprobe'
	@chmod 755 '$(DESTDIR)$(PREFIX)/bin/lightprobe'

uninstall: ## remove what make install has copied; the configuration stays
	@if [ -z '$(DESTDIR)' ] && [ -d /run/systemd/system ]; then systemctl disable --now lightprobed; fi
	@rm -rf $(INSTALLED:%='$(DESTDIR)$(PREFIX)'/%)
	@$(if $(DESTDIR),,packaging/system-reload)
	@echo 'uninstall: done; $(CONFIG) and drop-ins under /etc/systemd are kept'

check-service: ## print systemd's rating of the service's isolation, from 0 (best) to 10, and its reasons
	@systemd-analyze --no-pager security --offline=yes packaging/systemd/lightprobed.service
