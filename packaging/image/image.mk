# SPDX-License-Identifier: Apache-2.0
# The image of a probe's card.

.PHONY: image test-image
# What signs updates. Probes take updates only from who has the key of their image: keep it, and keep it secret.
UPDATE_KEYS ?= $(if $(SUDO_USER),$(shell getent passwd $(SUDO_USER) | cut -d: -f6),$(HOME))/.config/lightprobe/update
IMAGE_VERSION ?= $(shell git log -1 --format=%cd-%h --date=format:%Y%m%d%H%M)

image: $(STAMPS)/sysroot-arm64 $(call apt,image) build ## make the image of a card for the Raspberry Pi 4 in build/image, as root (ten minutes)
	@$(MAKE) VARIANT=arm64 -j$(JOBS) daemon
	@/usr/bin/python3 packaging/image/make_image.py --out $(BUILD)/image --daemon $(BUILD)/arm64/bin/lightprobed \
		--keys "$(UPDATE_KEYS)" --version $(IMAGE_VERSION)

test-image: image ## boot the image in QEMU: first start, light in a client, set-up page, updates, power cuts
	@$(VENV)/bin/pytest -q -s tests/image
