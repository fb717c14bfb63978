/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/ptp/properties.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"

/* Until a camera at work takes its options back. */
#define BUSY_PATIENCE_NS (10 * LP_NS_PER_S)
#define BUSY_US 100000

static int get(struct lp_ptp_camera *camera, uint16_t property, const uint8_t **data,
	       size_t *size_bytes, struct lp_ptp_fault *fault)
{
	char stage[32];
	const int ret =
		lp_ptp_get(&camera->session, LP_PTP_GET_PROPERTY, property, data, size_bytes);

	(void)snprintf(stage, sizeof(stage), "property 0x%04x", property);
	return ret < 0 ? lp_ptp_camera_fail(camera, ret, stage, fault) : 0;
}

int lp_ptp_get_number(struct lp_ptp_camera *camera, uint16_t property, uint64_t *value,
		      struct lp_ptp_fault *fault)
{
	struct lp_ptp_reader reader;
	const uint8_t *data;
	size_t size_bytes;
	const int ret = get(camera, property, &data, &size_bytes, fault);

	if (ret < 0)
		return ret;
	reader = lp_ptp_reader_of(data, size_bytes);
	*value = lp_ptp_read(&reader, size_bytes < 8 ? (int)size_bytes : 8);
	return 0;
}

/* Remember what a property was, the first time. */
static int save(struct lp_ptp_camera *camera, uint16_t property, struct lp_ptp_fault *fault)
{
	struct lp_ptp_saved *saved = &camera->saved[camera->saved_count];
	const uint8_t *data;
	size_t size_bytes;
	int ret;

	for (int i = 0; i < camera->saved_count; i++)
		if (camera->saved[i].property == property)
			return 0;
	ret = get(camera, property, &data, &size_bytes, fault);
	if (ret < 0)
		return ret;
	if (size_bytes > sizeof(saved->value) || camera->saved_count == LP_PTP_OPTIONS)
		return lp_ptp_camera_fail(camera, -EFBIG, "save", fault);
	saved->property = property;
	saved->size_bytes = size_bytes;
	memcpy(saved->value, data, size_bytes);
	camera->saved_count++;
	return 0;
}

static int put(struct lp_ptp_camera *camera, uint16_t property, const uint8_t *value,
	       size_t size_bytes)
{
	const struct lp_ptp_operands operands = {.parameters = {property},
						 .parameter_count = 1,
						 .data = value,
						 .data_bytes = size_bytes};

	return lp_ptp_operate(&camera->session, LP_PTP_SET_PROPERTY, &operands, NULL);
}

int lp_ptp_set(struct lp_ptp_camera *camera, const struct lp_ptp_wish *wish, const uint8_t *value,
	       size_t size_bytes, struct lp_ptp_fault *fault)
{
	const struct lp_ptp_device *device = &camera->device;
	char text[64];
	int ret;

	if (!lp_ptp_has(device->properties, device->property_count, wish->property) &&
	    wish->is_optional)
		return 0;
	ret = save(camera, wish->property, fault);
	if (ret < 0)
		return ret == -EREMOTEIO && wish->is_optional ? 0 : ret;
	ret = put(camera, wish->property, value, size_bytes);
	if (ret != -EREMOTEIO || camera->session.response == LP_PTP_DEVICE_BUSY)
		return ret < 0 ? lp_ptp_camera_fail(camera, ret, wish->name, fault) : 0;
	if (wish->is_optional) {
		lp_warning(camera->object, wish->name, "not set: %s",
			   lp_ptp_response_text(camera->session.response, text));
		return 0;
	}
	return lp_ptp_fail(fault, ret, LP_SOURCE_DOWN, wish->name,
			   "the camera refuses: %s — update its firmware (now %s)",
			   lp_ptp_response_text(camera->session.response, text),
			   camera->device.version);
}

int lp_ptp_set_number(struct lp_ptp_camera *camera, const struct lp_ptp_wish *wish,
		      struct lp_ptp_fault *fault)
{
	uint8_t value[8];

	(void)lp_ptp_write(value, wish->value, wish->bytes);
	return lp_ptp_set(camera, wish, value, (size_t)wish->bytes, fault);
}

int lp_ptp_put_back(struct lp_ptp_camera *camera, const struct lp_ptp_saved *saved)
{
	static const uint8_t single[] = {LP_PTP_MODE_SINGLE, 0};
	char text[64];
	const int64_t end_ns = lp_clock_ns() + BUSY_PATIENCE_NS;
	int ret;

	while ((ret = put(camera, saved->property, saved->value, saved->size_bytes)) ==
		       -EREMOTEIO &&
	       camera->session.response == LP_PTP_DEVICE_BUSY && lp_clock_ns() < end_ns)
		usleep(BUSY_US);
	if (ret == -EREMOTEIO) {
		lp_warning(camera->object, "restore", "property 0x%04x: %s", saved->property,
			   lp_ptp_response_text(camera->session.response, text));
		ret = 0;
	}
	/* the rest was set in this mode */
	if (ret == 0 && saved->property == LP_PTP_BRACKET)
		ret = put(camera, LP_PTP_STILL_CAPTURE_MODE, single, sizeof(single));
	return ret == -EREMOTEIO ? 0 : ret;
}
