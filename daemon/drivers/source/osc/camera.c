/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/osc/camera.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "drivers/source/osc/camera_parts.h"
#include "drivers/source/osc/reply.h"

#define MANUAL 1
#define SHUTTER_PRIORITY 4
#define ISO_PRIORITY 9
#define NEVER_S 65535 /* of sleepDelay and offDelay */
#define FIRST_US 8000.0F
/* A camera that is busy is asked again after this, for so long: a change of mode takes a while. */
#define BUSY_PAUSE_NS (100 * LP_NS_PER_MS)
#define BUSY_PATIENCE_NS (10 * LP_NS_PER_S)
/* RICOH: "an interval of 1 second or more" between options and live preview. It begins when the
 * answer is here, which is later than what it answers; the rest is for the camera's clock. */
#define AFTER_OPTIONS_NS (1010 * LP_NS_PER_MS)
/* Fewer frames a second are too few for brackets, if there is another choice. */
#define LEAST_RATE_HZ 15.0F

void lp_osc_camera_init(struct lp_osc_camera *camera, const struct lp_osc_settings *settings,
			struct lp_osc_http *http)
{
	*camera = (struct lp_osc_camera){.settings = settings, .http = http};
	camera->exposure_us = camera->gain = NAN;
	(void)snprintf(camera->object, sizeof(camera->object),
		       settings->port == 80 ? "osc: %s" : "osc: %s:%d", settings->host,
		       settings->port);
}

void lp_osc_camera_finish(struct lp_osc_camera *camera)
{
	json_decref(camera->saved);
	camera->saved = NULL;
}

/* ---------------------------------------------------------------- commands */

/* False: the wait was canceled. */
static bool pause_until(const struct lp_osc_camera *camera, int64_t due_ns)
{
	struct lp_osc_reply reply;
	int64_t left_ns;

	while ((left_ns = due_ns - lp_clock_ns()) > 0) {
		if (lp_osc_http_end(camera->http, &reply) == -ECANCELED)
			return false;
		lp_osc_http_turn(camera->http, (int)(left_ns / LP_NS_PER_MS) + 1);
	}
	return true;
}

static int send_command(struct lp_osc_camera *camera, const char *name, const char *body,
			json_t **answer, struct lp_osc_fault *fault)
{
	const int64_t end_ns = lp_clock_ns() + BUSY_PATIENCE_NS;
	struct lp_osc_reply reply;
	int ret;

	for (;;) {
		ret = lp_osc_http_request(camera->http, "/osc/commands/execute", body, &reply);
		if (ret < 0)
			return lp_osc_network_fault(ret, name, fault);
		ret = lp_osc_reply_check(&reply, name, *camera->settings->login.user, answer,
					 fault);
		if (ret != -EAGAIN || lp_clock_ns() > end_ns)
			return ret;
		if (!pause_until(camera, lp_clock_ns() + BUSY_PAUSE_NS))
			return -ECANCELED;
	}
}

/* Takes over `parameters`. `results` (may be NULL): to be released by the caller. */
static int execute(struct lp_osc_camera *camera, const char *name, json_t *parameters,
		   json_t **results, struct lp_osc_fault *fault)
{
	json_t *command = json_pack("{s:s, s:o}", "name", name, "parameters", parameters);
	char *body = command ? json_dumps(command, LP_OSC_JSON) : NULL;
	json_t *answer = NULL;
	const int ret = body ? send_command(camera, name, body, &answer, fault)
			     : lp_osc_fail(fault, -ENOMEM, LP_SOURCE_STALLED, name, "no memory");

	if (ret == 0 && results)
		*results = json_incref(json_object_get(answer, "results"));
	free(body);
	json_decref(command);
	json_decref(answer);
	return ret;
}

int lp_osc_set_options(struct lp_osc_camera *camera, json_t *options, struct lp_osc_fault *fault)
{
	const int ret = execute(camera, "camera.setOptions", json_pack("{s:o}", "options", options),
				NULL, fault);

	camera->changed_ns = lp_clock_ns();
	return ret;
}

int lp_osc_get_options(struct lp_osc_camera *camera, const char *const *names, json_t **options,
		       struct lp_osc_fault *fault)
{
	json_t *list = json_array(), *results = NULL;
	int ret;

	for (; *names; names++)
		(void)json_array_append_new(list, json_string(*names));
	ret = execute(camera, "camera.getOptions", json_pack("{s:o}", "optionNames", list),
		      &results, fault);
	*options = json_incref(json_object_get(results, "options"));
	json_decref(results);
	if (ret == 0 && !json_is_object(*options)) {
		json_decref(*options);
		*options = NULL;
		ret = lp_osc_fail(fault, -EPROTO, LP_SOURCE_DOWN, "camera.getOptions",
				  "the answer has no options — is this camera's firmware current?");
	}
	return ret;
}

/* ---------------------------------------------------------------- what it is */

static void copy_text(char *text, size_t size_bytes, const json_t *object, const char *key)
{
	const char *value = json_string_value(json_object_get(object, key));

	(void)snprintf(text, size_bytes, "%s", value ? value : "unknown");
}

static int not_osc(struct lp_osc_fault *fault)
{
	return lp_osc_fail(
		fault, -EPROTO, LP_SOURCE_DOWN, "/osc/info",
		"no Open Spherical Camera with API 2.1 answers there — check the address");
}

static bool has_api_2(const json_t *info)
{
	const json_t *levels = json_object_get(info, "apiLevel");
	const json_t *level;
	size_t i;

	json_array_foreach(levels, i, level)
	{
		if (json_integer_value(level) == 2)
			return true;
	}
	return false;
}

static int read_info(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	struct lp_osc_reply reply;
	json_t *info = NULL;
	int ret = lp_osc_http_request(camera->http, "/osc/info", NULL, &reply);

	if (ret < 0)
		return lp_osc_network_fault(ret, "/osc/info", fault);
	ret = lp_osc_reply_check(&reply, "/osc/info", *camera->settings->login.user, &info, fault);
	if (ret < 0)
		return ret == -EACCES || ret == -EAGAIN ? ret : not_osc(fault);
	copy_text(camera->model, sizeof(camera->model), info, "model");
	copy_text(camera->firmware, sizeof(camera->firmware), info, "firmwareVersion");
	copy_text(camera->serial, sizeof(camera->serial), info, "serialNumber");
	ret = has_api_2(info) ? 0 : not_osc(fault);
	json_decref(info);
	/* Another camera answers there now: what the first one was is of no use to it. */
	if (ret == 0 && camera->saved && strcmp(camera->saved_serial, camera->serial) != 0)
		lp_osc_camera_finish(camera);
	return ret;
}

/* ---------------------------------------------------------------- which preview */

#define MOST_RATE_HZ 1000.0 /* it is written back as an integer */

/* 0: it does not say, or what cannot be. */
static float rate_of(const json_t *format)
{
	const double rate_hz = json_number_value(json_object_get(format, "framerate"));

	return rate_hz > 0.0 && rate_hz <= MOST_RATE_HZ ? (float)rate_hz : 0.0F;
}

/* Equirectangular ones only. */
static void read_formats(const json_t *formats, float least_hz, struct lp_offers *offers)
{
	const json_t *format;
	size_t i;

	offers->count = 0;
	json_array_foreach(formats, i, format)
	{
		const json_int_t width = json_integer_value(json_object_get(format, "width"));
		const json_int_t height = json_integer_value(json_object_get(format, "height"));

		if (offers->count == LP_MAX_OFFERS || width < 2 || width > 16384 ||
		    width % 2 != 0 || height != width / 2 || rate_of(format) < least_hz)
			continue;
		offers->list[offers->count++] = (struct lp_offer){.fourcc = LP_FOURCC_MJPEG,
								  .width_px = (uint32_t)width,
								  .height_px = (uint32_t)height,
								  .rate_count = 1,
								  .rates_hz = {rate_of(format)}};
	}
}

static int choose_preview(struct lp_osc_camera *camera, const json_t *formats,
			  struct lp_osc_fault *fault)
{
	const struct lp_offer_wish *wish = &camera->settings->wish;
	const bool is_free = wish->fps <= 0 && !wish->size_px.width;
	struct lp_offers offers;
	char text[300];
	int ret;

	read_formats(formats, is_free ? LEAST_RATE_HZ : 0, &offers);
	if (offers.count == 0)
		read_formats(formats, 0, &offers);
	ret = lp_offers_choose(&offers, wish, &camera->choice);
	if (ret == 0)
		return 0;
	lp_offers_refuse(&offers, wish, text, sizeof(text));
	return lp_osc_fail(fault, ret, LP_SOURCE_DOWN, "previewFormat", "%s (firmware %s)", text,
			   camera->firmware);
}

static json_t *preview_option(const struct lp_osc_camera *camera)
{
	const struct lp_offer_choice *choice = &camera->choice;

	return json_pack("{s:i, s:i, s:i}", "width", (int)choice->width_px, "height",
			 (int)choice->height_px, "framerate", (int)lrintf(choice->rate_hz));
}

/* ---------------------------------------------------------------- what it was */

static const char *mode_name(const struct lp_osc_camera *camera)
{
	return camera->settings->mode == LP_OSC_VIDEO ? "video" : "image";
}

static int enter_mode(struct lp_osc_camera *camera, const json_t *options,
		      struct lp_osc_fault *fault)
{
	const char *const wanted = mode_name(camera);
	const char *const present = json_string_value(json_object_get(options, "captureMode"));
	int ret;

	if (present && strcmp(present, wanted) == 0)
		return 0;
	ret = lp_osc_set_options(camera, json_pack("{s:s}", "captureMode", wanted), fault);
	if (ret == -EINVAL)
		ret = lp_osc_fail(fault, ret, LP_SOURCE_DOWN, "captureMode",
				  "%s (firmware %s) has no mode '%s' — try mode=%s", camera->model,
				  camera->firmware, wanted,
				  camera->settings->mode == LP_OSC_VIDEO ? "image" : "video");
	return ret;
}

void lp_osc_remember(struct lp_osc_camera *camera, const json_t *options)
{
	if (!camera->saved) {
		camera->saved = json_object();
		(void)snprintf(camera->saved_serial, sizeof(camera->saved_serial), "%s",
			       camera->serial);
	}
	(void)json_object_update_missing(camera->saved, (json_t *)options);
}

static int no_preview(const struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	return lp_osc_fail(fault, -ENOSYS, LP_SOURCE_DOWN, "previewFormat",
			   "%s (firmware %s) has no live preview — see docs/users/which_camera.md",
			   camera->model, camera->firmware);
}

static int prepare_mode(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	static const char *const common[] = {"captureMode", "previewFormat", "sleepDelay",
					     "offDelay", NULL};
	static const char *const formats[] = {"previewFormatSupport", NULL};
	json_t *options = NULL, *support = NULL;
	int ret = lp_osc_get_options(camera, formats, &support, fault);

	if (ret == -ENOENT || ret == -ENOSYS)
		return no_preview(camera, fault);
	if (ret == 0)
		ret = choose_preview(camera, json_object_get(support, "previewFormatSupport"),
				     fault);
	json_decref(support);
	if (ret < 0)
		return ret;
	ret = lp_osc_get_options(camera, common, &options, fault);
	if (ret == 0) {
		lp_osc_remember(camera, options);
		ret = enter_mode(camera, options, fault);
	}
	json_decref(options);
	return ret;
}

/* ---------------------------------------------------------------- exposure */

static bool has_manual(const json_t *options)
{
	const json_t *program;
	size_t i;

	json_array_foreach(json_object_get(options, "exposureProgramSupport"), i, program)
	{
		if (json_integer_value(program) == MANUAL)
			return true;
	}
	return false;
}

/* Manual exposure, and what it offers. */
static int make_manual(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	static const char *const names[] = {"shutterSpeedSupport", "isoSupport", NULL};
	struct lp_osc_exposures *range = &camera->range;
	const int iso = camera->settings->iso;
	json_t *options = NULL;
	int ret = lp_osc_set_options(camera, json_pack("{s:i}", "exposureProgram", MANUAL), fault);

	if (ret == 0)
		ret = lp_osc_get_options(camera, names, &options, fault);
	if (ret < 0)
		return ret;
	ret = lp_osc_exposures_read(range, options, camera->choice.rate_hz, iso);
	json_decref(options);
	if (ret == -EPROTO)
		return lp_osc_fail(fault, ret, LP_SOURCE_DOWN, "shutterSpeedSupport",
				   "%s (firmware %s) lists no values — update it, or use "
				   "exposure=auto",
				   camera->model, camera->firmware);
	if (ret == -EINVAL)
		return lp_osc_fail(fault, ret, LP_SOURCE_DOWN, "iso",
				   "%d is not offered — %s has %d to %d in thirds of a stop", iso,
				   camera->model, range->isos[0],
				   range->isos[range->iso_count - 1]);
	return ret;
}

char *lp_osc_camera_exposure_body(const struct lp_osc_camera *camera, float exposure_us, float gain)
{
	json_t *options = lp_osc_exposures_options(&camera->range, exposure_us, gain);
	json_t *command = json_pack("{s:s, s:{s:o}}", "name", "camera.setOptions", "parameters",
				    "options", options);
	char *body = command ? json_dumps(command, LP_OSC_JSON) : NULL;

	json_decref(command);
	return body;
}

/* ---------------------------------------------------------------- holding it all */

static void add_white_balance(const struct lp_osc_camera *camera, json_t *options)
{
	const int wanted_k = camera->settings->white_balance_k;

	if (wanted_k == 0)
		return;
	(void)json_object_set_new(options, "whiteBalance", json_string("_colorTemperature"));
	(void)json_object_set_new(options, "_colorTemperature",
				  json_integer((wanted_k + 50) / 100 * 100));
}

/* A camera that sleeps has no network: the daemon could not wake it. */
static void keep_awake(struct lp_osc_camera *camera)
{
	struct lp_osc_fault fault;
	const int ret = lp_osc_set_options(camera,
					   json_pack("{s:i, s:i}", "sleepDelay", NEVER_S,
						     "offDelay", NEVER_S),
					   &fault);

	if (ret < 0 && ret != -ECANCELED)
		lp_warning(camera->object, "sleepDelay",
			   "the camera may fall asleep (%s) — set sleep and power-off to never on "
			   "the camera itself",
			   fault.reason);
}

static int hold(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	json_t *options = json_object();

	camera->exposure_us = camera->gain = NAN;
	if (camera->exposure_settable) {
		camera->exposure_us = FIRST_US;
		camera->gain = 1;
		lp_osc_exposures_snap(&camera->range, &camera->exposure_us, &camera->gain);
		(void)json_object_update_new(options, lp_osc_exposures_options(&camera->range,
									       camera->exposure_us,
									       camera->gain));
	}
	add_white_balance(camera, options);
	(void)json_object_set_new(options, "previewFormat", preview_option(camera));
	return lp_osc_set_options(camera, options, fault);
}

static int prepare_exposure(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	static const char *const names[] = {"exposureProgram",
					    "exposureProgramSupport",
					    "shutterSpeed",
					    "iso",
					    "whiteBalance",
					    "_colorTemperature",
					    NULL};
	json_t *options = NULL;
	int ret = lp_osc_get_options(camera, names, &options, fault);

	if (ret < 0)
		return ret;
	camera->exposure_settable = camera->settings->exposure_settable && has_manual(options) &&
				    !lp_osc_has_filter(camera);
	if (camera->settings->exposure_settable && lp_osc_has_filter(camera))
		lp_warning(
			camera->object, "exposure",
			"an image filter of the camera is on, which makes its exposure automatic: "
			"exposures are unknown and brackets are off — switch _filter off");
	else if (camera->settings->exposure_settable && !camera->exposure_settable)
		lp_warning(camera->object, "exposure",
			   "%s (firmware %s) has no manual exposure in the mode '%s': exposures "
			   "are unknown and brackets are off — update its firmware, or try mode=%s",
			   camera->model, camera->firmware, mode_name(camera),
			   camera->settings->mode == LP_OSC_VIDEO ? "image" : "video");
	(void)json_object_del(options, "exposureProgramSupport");
	lp_osc_remember(camera, options);
	lp_osc_look_at_white_balance(camera, options);
	json_decref(options);
	return camera->exposure_settable ? make_manual(camera, fault) : 0;
}

static void announce(const struct lp_osc_camera *camera)
{
	char exposure[48] = "of unknown exposure";

	if (camera->exposure_settable)
		(void)snprintf(exposure, sizeof(exposure), "exposed %g us, ISO %d",
			       (double)camera->exposure_us, camera->range.base_iso);
	lp_info(camera->object, "open",
		"%s, serial number %s, firmware %s: MJPG %ux%u at %g Hz, %s", camera->model,
		camera->serial, camera->firmware, camera->choice.width_px, camera->choice.height_px,
		(double)camera->choice.rate_hz, exposure);
}

int lp_osc_camera_open(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	int ret = read_info(camera, fault);

	if (ret == 0)
		ret = prepare_mode(camera, fault);
	if (ret == 0)
		ret = lp_osc_neutralize(camera, fault);
	if (ret == 0)
		ret = prepare_exposure(camera, fault);
	if (ret == 0)
		ret = hold(camera, fault);
	if (ret < 0)
		return ret;
	keep_awake(camera);
	announce(camera);
	lp_processing_tell(&camera->processing, camera->settings->processing == LP_PROCESSING_KEEP,
			   &camera->processing_told, camera->object);
	return pause_until(camera, camera->changed_ns + AFTER_OPTIONS_NS) ? 0 : -ECANCELED;
}

int lp_osc_camera_show_capture(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	const int ret =
		lp_osc_set_options(camera, json_pack("{s:s}", "_cameraMode", "capture"), fault);

	if (ret == 0 && !pause_until(camera, camera->changed_ns + AFTER_OPTIONS_NS))
		return -ECANCELED;
	return ret;
}

/* ---------------------------------------------------------------- putting it back */

/* Of what was saved, in a form that the camera takes: values that are automatic cannot be set. */
static json_t *options_before(const struct lp_osc_camera *camera)
{
	json_t *options = json_copy(camera->saved);
	const json_int_t program = json_integer_value(json_object_get(options, "exposureProgram"));

	if (program != MANUAL && program != SHUTTER_PRIORITY)
		(void)json_object_del(options, "shutterSpeed");
	if (program != MANUAL && program != ISO_PRIORITY)
		(void)json_object_del(options, "iso");
	(void)json_object_del(options, "captureMode");
	lp_osc_leave_out_processing(options);
	return options;
}

static int restore(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	const json_t *mode = json_object_get(camera->saved, "captureMode");
	/* Exposure is kept for each mode: first go where it was changed. */
	int ret = lp_osc_set_options(camera, json_pack("{s:s}", "captureMode", mode_name(camera)),
				     fault);

	if (ret == 0)
		ret = lp_osc_set_options(camera, options_before(camera), fault);
	if (ret == 0)
		ret = lp_osc_restore_processing(camera, fault);
	if (ret == 0 && json_is_string(mode) &&
	    strcmp(json_string_value(mode), mode_name(camera)) != 0)
		ret = lp_osc_set_options(camera, json_pack("{s:O}", "captureMode", mode), fault);
	return ret;
}

void lp_osc_camera_restore(struct lp_osc_camera *camera, int64_t left_ns)
{
	struct lp_osc_fault fault = {.reason = "no time was left"};
	int ret;

	if (!camera->saved)
		return;
	lp_osc_http_stream_close(camera->http);
	lp_osc_http_last_words(camera->http, left_ns);
	ret = restore(camera, &fault);
	if (ret < 0)
		lp_warning(camera->object, "restore",
			   "the camera's options are not as they were (%s) — set them on the "
			   "camera",
			   fault.reason);
	else
		lp_info(camera->object, "restore", "the camera's options are as they were");
}
