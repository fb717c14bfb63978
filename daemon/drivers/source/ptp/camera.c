/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/ptp/camera.h"

#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/macros.h"
#include "drivers/source/ptp/properties.h"

#define SESSION 1
#define FORMAT_JPEG 0x3801 /* EXIF/JPEG */

int lp_ptp_fail(struct lp_ptp_fault *fault, int error, enum lp_source_state state,
		const char *stage, const char *format, ...)
{
	va_list arguments;

	fault->state = state;
	(void)snprintf(fault->stage, sizeof(fault->stage), "%s", stage);
	va_start(arguments, format);
	(void)vsnprintf(fault->reason, sizeof(fault->reason), format, arguments);
	va_end(arguments);
	return error;
}

void lp_ptp_camera_init(struct lp_ptp_camera *camera, const struct lp_ptp_settings *settings)
{
	memset(camera, 0, sizeof(*camera));
	camera->settings = settings;
	(void)snprintf(camera->object, sizeof(camera->object), "ptp: %s",
		       *settings->serial ? settings->serial : "THETA");
}

int lp_ptp_camera_fail(struct lp_ptp_camera *camera, int error, const char *stage,
		       struct lp_ptp_fault *fault)
{
	char text[64];

	switch (error) {
	case -ECANCELED:
		return error;
	case -ENODEV:
		return lp_ptp_fail(fault, error, LP_SOURCE_WAITING, stage,
				   "unplugged: waiting for it to come back");
	case -ETIMEDOUT:
		return lp_ptp_fail(fault, error, LP_SOURCE_WAITING, stage,
				   "no answer: beginning again — if it stays so, switch the camera "
				   "off and on");
	case -EREMOTEIO:
		if (camera->session.response == LP_PTP_DEVICE_BUSY)
			return lp_ptp_fail(fault, -EAGAIN, LP_SOURCE_WAITING, stage,
					   "the camera is busy");
		return lp_ptp_fail(fault, error, LP_SOURCE_WAITING, stage, "the camera refuses: %s",
				   lp_ptp_response_text(camera->session.response, text));
	case -EIO:
		return lp_ptp_fail(fault, error, LP_SOURCE_WAITING, stage,
				   "a transfer broke off (unplugged?): beginning again");
	case -EPROTO:
	case -EFBIG:
		return lp_ptp_fail(fault, error, LP_SOURCE_WAITING, stage,
				   "an answer that is no PTP: beginning again");
	default:
		return lp_ptp_fail(fault, error, LP_SOURCE_WAITING, stage, "%s: beginning again",
				   lp_strerror(error));
	}
}

/* ---------------------------------------------------------------- which camera */

static int begin_session(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault)
{
	const struct lp_ptp_operands operands = {.parameters = {SESSION}, .parameter_count = 1};
	int ret = lp_ptp_operate(&camera->session, LP_PTP_OPEN_SESSION, &operands, NULL);

	/* Nobody else can have it, as the interface is ours: it was left by who crashed. */
	if (ret == -EREMOTEIO && camera->session.response == LP_PTP_SESSION_ALREADY_OPEN) {
		ret = lp_ptp_operate(&camera->session, LP_PTP_CLOSE_SESSION, NULL, NULL);
		if (ret == 0)
			ret = lp_ptp_operate(&camera->session, LP_PTP_OPEN_SESSION, &operands,
					     NULL);
	}
	camera->has_session = ret == 0;
	return ret < 0 ? lp_ptp_camera_fail(camera, ret, "session", fault) : 0;
}

/* Model and firmware tell how brackets are laid out. */
static int find_family(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault)
{
	static const struct {
		const char *model;
		enum lp_ptp_family family;
		int least_firmware;
	} known[] = {{"RICOH THETA X", LP_PTP_THETA_X, 0},
		     {"RICOH THETA Z1", LP_PTP_THETA_Z1, 0},
		     {"RICOH THETA V", LP_PTP_THETA_V, 3}};
	const struct lp_ptp_device *device = &camera->device;

	for (size_t i = 0; i < LP_COUNT(known); i++) {
		if (strcmp(device->model, known[i].model) != 0)
			continue;
		if (strtol(device->version, NULL, 10) < known[i].least_firmware)
			return lp_ptp_fail(fault, -EPROTONOSUPPORT, LP_SOURCE_DOWN, "model",
					   "firmware %s has other brackets — update it to %d.00 or "
					   "later",
					   device->version, known[i].least_firmware);
		camera->family = known[i].family;
		return 0;
	}
	return lp_ptp_fail(
		fault, -EPROTONOSUPPORT, LP_SOURCE_DOWN, "model",
		"%s %s: brackets are known of RICOH THETA X, Z1 and V only — connect one "
		"of these",
		device->manufacturer, device->model);
}

static int identify(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault)
{
	struct lp_ptp_device *device = &camera->device;
	const uint8_t *data = NULL;
	size_t size_bytes = 0;
	int ret = lp_ptp_drain(&camera->session);

	if (ret == 0)
		ret = lp_ptp_get(&camera->session, LP_PTP_GET_DEVICE_INFO, 0, &data, &size_bytes);
	if (ret < 0)
		return lp_ptp_camera_fail(camera, ret, "device info", fault);
	if (!lp_ptp_device_read(data, size_bytes, device))
		return lp_ptp_camera_fail(camera, -EPROTO, "device info", fault);
	(void)snprintf(camera->object, sizeof(camera->object), "%.60s, %.30s", device->model,
		       device->serial);
	if (*camera->saved_serial && strcmp(camera->saved_serial, device->serial) != 0)
		camera->saved_count = 0; /* another one: its own options are to be put back */
	(void)snprintf(camera->saved_serial, sizeof(camera->saved_serial), "%s", device->serial);
	ret = find_family(camera, fault);
	if (ret < 0)
		return ret;
	if (!lp_ptp_has(device->operations, device->operation_count,
			LP_PTP_INITIATE_OPEN_CAPTURE) ||
	    device->functional_mode != 0)
		return lp_ptp_fail(fault, -EBUSY, LP_SOURCE_WAITING, "model",
				   "takes no pictures over USB now — end its menus, its plug-in or "
				   "its playback");
	return 0;
}

/* Live streaming and stills exclude each other. */
static int look_at_mode(struct lp_ptp_camera *camera, bool *is_ours, struct lp_ptp_fault *fault)
{
	uint64_t mode = 0, status = 0;
	int ret = lp_ptp_get_number(camera, LP_PTP_STILL_CAPTURE_MODE, &mode, fault);

	if (ret == 0)
		ret = lp_ptp_get_number(camera, LP_PTP_CAPTURE_STATUS, &status, fault);
	if (ret < 0)
		return ret;
	*is_ours = mode == LP_PTP_MODE_BRACKET;
	if (mode == LP_PTP_MODE_LIVE)
		return lp_ptp_fail(fault, -EBUSY, LP_SOURCE_WAITING, "mode",
				   "is in its live streaming mode, which takes no stills — press "
				   "its mode button, and stream from another camera");
	if (status != 0)
		return lp_ptp_fail(fault, -EAGAIN, LP_SOURCE_WAITING, "mode",
				   "takes other pictures now — end that");
	return 0;
}

/* ---------------------------------------------------------------- what it shall do */

static int get_values(struct lp_ptp_camera *camera, uint16_t property, struct lp_ptp_values *values,
		      const char *stage, struct lp_ptp_fault *fault)
{
	const uint8_t *data;
	size_t size_bytes;
	const int ret = lp_ptp_get(&camera->session, LP_PTP_GET_PROPERTY_DESCRIPTION, property,
				   &data, &size_bytes);

	if (ret < 0)
		return lp_ptp_camera_fail(camera, ret, stage, fault);
	if (!lp_ptp_values_read(data, size_bytes, values))
		return lp_ptp_camera_fail(camera, -EPROTO, stage, fault);
	return 0;
}

static int choose_shutters(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault)
{
	const struct lp_ptp_settings *settings = camera->settings;
	struct lp_ptp_values values = {.count = 0};
	const int ret = get_values(camera, LP_PTP_SHUTTER_SPEED, &values, "shutter speeds", fault);

	if (ret < 0)
		return ret;
	camera->exposure_count = lp_ptp_choose(&values, settings->shortest_us, settings->stops,
					       settings->exposures, camera->shutters);
	for (int i = 0; i < camera->exposure_count; i++)
		camera->exposures_us[i] = lp_ptp_shutter_us(camera->shutters[i]);
	if (camera->exposure_count < settings->exposures)
		return lp_ptp_fail(
			fault, -ERANGE, LP_SOURCE_DOWN, "shutter speeds",
			"%d exposures %g stops apart from %g us on: the camera lists only %d of "
			"them — ask for fewer, or for smaller steps",
			settings->exposures, (double)settings->stops,
			(double)(camera->exposure_count ? camera->exposures_us[0]
							: settings->shortest_us),
			camera->exposure_count);
	return 0;
}

static int choose_iso(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault)
{
	const uint64_t wanted = (uint64_t)camera->settings->iso;
	uint64_t chosen = UINT64_MAX;
	struct lp_ptp_values values = {.count = 0};
	const int ret = get_values(camera, LP_PTP_ISO, &values, "sensitivities", fault);

	if (ret < 0)
		return ret;
	for (int i = 0; i < values.count; i++)
		if (wanted ? values.values[i] == wanted : values.values[i] < chosen)
			chosen = values.values[i];
	if (chosen > UINT16_MAX)
		return lp_ptp_fail(fault, -ERANGE, LP_SOURCE_DOWN, "iso",
				   "%" PRIu64 " is not offered — leave iso out: the lowest",
				   wanted);
	camera->iso = (int)chosen;
	return 0;
}

static int set_bracket(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault)
{
	static const struct lp_ptp_wish wish = {.property = LP_PTP_BRACKET, .name = "bracket"};
	uint8_t value[LP_PTP_BRACKET_BYTES(LP_PTP_MOST_EXPOSURES)];
	const struct lp_ptp_bracket bracket = {
		.family = camera->family,
		.count = camera->exposure_count,
		.shutters = camera->shutters,
		.iso = (uint16_t)camera->iso,
		.kelvins = (uint16_t)(camera->settings->white_balance_k / 100 * 100)};

	lp_ptp_bracket_write(&bracket, value);
	return lp_ptp_set(camera, &wish, value, LP_PTP_BRACKET_BYTES(bracket.count), fault);
}

static int prepare(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault)
{
	const uint64_t kelvins = (uint64_t)camera->settings->white_balance_k / 100 * 100;
	const struct lp_ptp_wish wishes[] = {
		/* shutter speeds and sensitivities are listed in full only for this */
		{LP_PTP_STILL_CAPTURE_MODE, 2, false, LP_PTP_MODE_SINGLE, "still mode"},
		{LP_PTP_PROGRAM, 2, false, LP_PTP_PROGRAM_MANUAL, "manual exposure"},
		{LP_PTP_WHITE_BALANCE, 2, false, LP_PTP_WHITE_BALANCE_KELVINS, "white balance"},
		{LP_PTP_COLOR_TEMPERATURE, 2, false, kelvins, "colour temperature"},
		{LP_PTP_CAPTURE_DELAY, 4, true, 0, "self-timer off"},
		{LP_PTP_SLEEP_DELAY, 2, true, 0, "no sleep"},
		{LP_PTP_AUTO_POWER_OFF_DELAY_S, 4, true, 0, "no power-off"},
		{LP_PTP_TOP_BOTTOM_CORRECTION, 1, true, 4, "no levelling"},
		{LP_PTP_IMAGE_FORMAT, 1, true, 0, "JPEG"},
		{LP_PTP_IMAGE_STITCHING, 2, true, 3, "fixed stitching"},
	};
	const struct lp_ptp_wish mode = {LP_PTP_STILL_CAPTURE_MODE, 2, false, LP_PTP_MODE_BRACKET,
					 "multi-bracket"};
	int ret = 0;

	for (size_t i = 0; i < LP_COUNT(wishes) && ret == 0; i++)
		ret = lp_ptp_set_number(camera, &wishes[i], fault);
	if (ret == 0)
		ret = choose_iso(camera, fault);
	if (ret == 0)
		ret = choose_shutters(camera, fault);
	if (ret == 0)
		ret = lp_ptp_set_number(camera, &mode, fault);
	return ret == 0 ? set_bracket(camera, fault) : ret;
}

int lp_ptp_camera_open(struct lp_ptp_camera *camera, struct lp_ptp_port *port, struct lp_stop *stop,
		       struct lp_ptp_fault *fault)
{
	int ret = lp_ptp_session_init(&camera->session, port, stop);

	bool is_ours;

	camera->has_session = false;
	if (ret < 0)
		return lp_ptp_camera_fail(camera, ret, "session", fault);
	ret = identify(camera, fault);
	if (ret == 0)
		ret = begin_session(camera, fault);
	if (ret == 0)
		ret = look_at_mode(camera, &is_ours, fault);
	return ret == 0 ? prepare(camera, fault) : ret;
}

void lp_ptp_camera_close(struct lp_ptp_camera *camera, bool restore)
{
	struct lp_ptp_session *session = &camera->session;
	int ret = 0;

	session->stop = NULL;
	/* The last change first: brackets before the mode that they belong to. */
	for (int i = camera->saved_count - 1; restore && camera->has_session && i >= 0; i--) {
		ret = lp_ptp_put_back(camera, &camera->saved[i]);
		if (ret < 0)
			break;
		camera->saved_count = i;
	}
	if (restore && camera->saved_count > 0)
		lp_warning(camera->object, "restore",
			   "its options could not be put back — set them in RICOH's app");
	if (restore && camera->has_session && ret == 0)
		(void)lp_ptp_operate(session, LP_PTP_CLOSE_SESSION, NULL, NULL);
	camera->has_session = false;
	lp_ptp_session_finish(session);
}

/* ---------------------------------------------------------------- stills */

int lp_ptp_camera_shoot(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault)
{
	const struct lp_ptp_operands operands = {.parameter_count = 2};
	bool is_ours;
	int ret = look_at_mode(camera, &is_ours, fault);

	if (ret == 0 && !is_ours)
		return lp_ptp_fail(fault, -EPIPE, LP_SOURCE_STALLED, "mode",
				   "somebody has changed its mode: preparing it again");
	if (ret < 0)
		return ret;
	ret = lp_ptp_operate(&camera->session, LP_PTP_INITIATE_OPEN_CAPTURE, &operands, NULL);
	return ret < 0 ? lp_ptp_camera_fail(camera, ret, "multi-bracket", fault) : 0;
}

void lp_ptp_camera_terminate(struct lp_ptp_camera *camera)
{
	const struct lp_ptp_operands operands = {.parameters = {UINT32_MAX}, .parameter_count = 1};

	(void)lp_ptp_operate(&camera->session, LP_PTP_TERMINATE_OPEN_CAPTURE, &operands, NULL);
}

int lp_ptp_camera_look(struct lp_ptp_camera *camera, uint32_t object, struct lp_ptp_fault *fault)
{
	struct lp_ptp_reader reader;
	const uint8_t *data;
	size_t size_bytes;
	const int ret =
		lp_ptp_get(&camera->session, LP_PTP_GET_OBJECT_INFO, object, &data, &size_bytes);

	if (ret < 0)
		return lp_ptp_camera_fail(camera, ret, "object info", fault);
	reader = lp_ptp_reader_of(data, size_bytes);
	(void)lp_ptp_read(&reader, 4); /* the storage */
	return lp_ptp_read(&reader, 2) == FORMAT_JPEG;
}

int lp_ptp_camera_fetch(struct lp_ptp_camera *camera, uint32_t object, struct lp_ptp_sink *sink,
			struct lp_ptp_fault *fault)
{
	const struct lp_ptp_operands operands = {.parameters = {object}, .parameter_count = 1};
	const int ret = lp_ptp_operate(&camera->session, LP_PTP_GET_OBJECT, &operands, sink);

	return ret < 0 ? lp_ptp_camera_fail(camera, ret, "picture", fault) : 0;
}

int lp_ptp_camera_delete(struct lp_ptp_camera *camera, uint32_t object, struct lp_ptp_fault *fault)
{
	const struct lp_ptp_operands operands = {.parameters = {object}, .parameter_count = 2};
	char text[64];
	int ret = lp_ptp_operate(&camera->session, LP_PTP_DELETE_OBJECT, &operands, NULL);

	if (ret < 0)
		ret = lp_ptp_camera_fail(camera, ret, "delete", fault);
	if (ret != -EREMOTEIO)
		return ret;
	lp_warning(camera->object, "delete", "a still stays in the camera: %s",
		   lp_ptp_response_text(camera->session.response, text));
	return 0;
}
