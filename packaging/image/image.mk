# SPDX-License-Identifier: Apache-2.0
# The image of a probe's card.

.PHONY: image test-image
image: $(STAMPS)/sysroot-arm64 $(call apt,image) build ## make the image of a card for the Raspberry Pi 4 in build/image, as root (ten minutes)
	@$(MAKE) VARIANT=arm64 -j$(JOBS) daemon
	@/usr/bin/python3 packaging/image/make_image.py --out $(BUILD)/image --daemon $(BUILD)/arm64/bin/lightprobed

test-image: image ## boot the image in QEMU: first start, light in a client, set-up page, power cuts
	@$(VENV)/bin/pytest -q -s tests/image
