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
INSTALLED := bin/lightprobed lib/systemd/system/lightprobed.service lib/sysusers.d/lightprobe.conf \
	lib/udev/rules.d/70-lightprobe.rules lib/udev/rules.d/71-lightprobe-mcu.rules \
	lib/udev/rules.d/72-lightprobe-iio.rules share/lightprobe
CONFIG := $(DESTDIR)/etc/lightprobe/lightprobed.conf

.PHONY: install uninstall check-service
install: ## copy daemon, service, rules and camera files to PREFIX=/usr/local, as root, after make build; an existing configuration stays
	@test -x $(BUILD)/release/bin/lightprobed || \
		{ echo 'install: build/release/bin/lightprobed is missing: run make build as yourself, then make install as root' >&2; exit 1; }
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
	fi
	@$(if $(DESTDIR),,packaging/system-reload)
	@echo 'install: done. Next: edit $(CONFIG), then: systemctl enable --now lightprobed (after an update: systemctl restart lightprobed)'

uninstall: ## remove what make install has copied; the configuration stays
	@if [ -z '$(DESTDIR)' ] && [ -d /run/systemd/system ]; then systemctl disable --now lightprobed; fi
	@rm -rf $(INSTALLED:%='$(DESTDIR)$(PREFIX)'/%)
	@$(if $(DESTDIR),,packaging/system-reload)
	@echo 'uninstall: done; $(CONFIG) and drop-ins under /etc/systemd are kept'

check-service: ## print systemd's rating of the service's isolation, from 0 (best) to 10, and its reasons
	@systemd-analyze --no-pager security --offline=yes packaging/systemd/lightprobed.service
