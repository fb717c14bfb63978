/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/osc/reply.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "base/macros.h"

int lp_osc_fail(struct lp_osc_fault *fault, int error, enum lp_source_state state,
		const char *stage, const char *format, ...)
{
	va_list arguments;

	fault->state = state;
	fault->stage = stage;
	va_start(arguments, format);
	(void)vsnprintf(fault->reason, sizeof(fault->reason), format, arguments);
	va_end(arguments);
	return error;
}

int lp_osc_network_fault(int error, const char *stage, struct lp_osc_fault *fault)
{
	switch (error) {
	case -ECANCELED:
		return error;
	case -ENXIO:
		return lp_osc_fail(fault, error, LP_SOURCE_WAITING, "resolve",
				   "no host has this name — give the camera's address");
	case -ECONNREFUSED:
		return lp_osc_fail(fault, error, LP_SOURCE_WAITING, "connect",
				   "no connection — is the camera switched on, awake and in this "
				   "network?");
	case -ETIMEDOUT:
		return lp_osc_fail(fault, error, LP_SOURCE_WAITING, stage,
				   "no answer — is the camera awake, and in reach?");
	default:
		return lp_osc_fail(fault, error, LP_SOURCE_WAITING, stage,
				   "the connection broke — trying again");
	}
}

/* ---------------------------------------------------------------- errors of the camera */

/* What RICOH publishes (protocols/errors.md). */
static const struct {
	const char *code;
	int error;
	enum lp_source_state state;
	const char *meaning;
} errors[] = {
	{"serviceUnavailable", -EAGAIN, LP_SOURCE_STALLED, "the camera is busy — trying again"},
	{"disabledCommand", -EPERM, LP_SOURCE_WAITING,
	 "refused — leave playback, settings, charging or USB mode, or let the camera cool"},
	{"powerOffSequenceRunning", -EPERM, LP_SOURCE_WAITING, "the camera is switching off"},
	{"unknownCommand", -ENOSYS, LP_SOURCE_DOWN, "the camera does not know this command"},
	{"invalidParameterName", -ENOENT, LP_SOURCE_DOWN, "the camera does not know this option"},
	{"invalidParameterValue", -EINVAL, LP_SOURCE_DOWN, "the camera does not take this value"},
	{"missingParameter", -EINVAL, LP_SOURCE_DOWN, "the camera does not take this command"},
};

static int camera_error(const json_t *error, const char *stage, struct lp_osc_fault *fault)
{
	const char *const code = json_string_value(json_object_get(error, "code"));
	const char *const message = json_string_value(json_object_get(error, "message"));

	for (size_t i = 0; code && i < LP_COUNT(errors); i++) {
		if (strcmp(code, errors[i].code) == 0)
			return lp_osc_fail(fault, errors[i].error, errors[i].state, stage,
					   "%s (%.40s)", errors[i].meaning, code);
	}
	return lp_osc_fail(fault, -EIO, LP_SOURCE_STALLED, stage,
			   "refused (%.40s: %.60s) — if it stays so, switch the camera off and on",
			   code ? code : "no code", message ? message : "");
}

int lp_osc_reply_check(const struct lp_osc_reply *reply, const char *stage, bool has_login,
		       json_t **json, struct lp_osc_fault *fault)
{
	json_t *answer;
	int ret = 0;

	if (reply->status == 401)
		return lp_osc_fail(fault, -EACCES, LP_SOURCE_DOWN, "password",
				   has_login ? "the camera refuses user or password — correct the "
					       "password file"
					     : "the camera asks for a password — give it in a "
					       "file: ?password_file=FILE");
	answer = json_loadb(reply->text, reply->text_bytes, 0, NULL);
	if (json_is_object(json_object_get(answer, "error")))
		ret = camera_error(json_object_get(answer, "error"), stage, fault);
	else if (!json_is_object(answer) || reply->status != 200)
		ret = lp_osc_fail(fault, -EPROTO, LP_SOURCE_DOWN, stage,
				  "the answer (HTTP status %d) is no camera's — check the address",
				  reply->status);
	if (ret == 0 && json)
		*json = json_incref(answer);
	json_decref(answer);
	return ret;
}

/* ---------------------------------------------------------------- health */

/* What cannot be is not said. */
static float number_or_nan(const json_t *object, const char *key, float least, float most)
{
	const json_t *value = json_object_get(object, key);
	const float number = json_is_number(value) ? (float)json_number_value(value) : NAN;

	return number >= least && number <= most ? number : NAN;
}

bool lp_osc_health_read(const struct lp_osc_reply *reply, struct lp_osc_health *health)
{
	json_t *answer = json_loadb(reply->text, reply->text_bytes, 0, NULL);
	const json_t *state = json_object_get(answer, "state");
	const char *const power = json_string_value(json_object_get(state, "_batteryState"));
	const char *const error =
		json_string_value(json_array_get(json_object_get(state, "_cameraError"), 0));
	const bool is_state = json_is_object(state);

	*health = (struct lp_osc_health){
		.battery = number_or_nan(state, "batteryLevel", 0.0F, 1.0F),
		.is_charging = power && strcmp(power, "disconnect") != 0,
		.temperature_c = number_or_nan(state, "_boardTemp", -100.0F, 300.0F),
	};
	(void)snprintf(health->error, sizeof(health->error), "%s", error ? error : "");
	json_decref(answer);
	return is_state;
}
