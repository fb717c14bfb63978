/* SPDX-License-Identifier: Apache-2.0 */
#include "controls.h"
#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <linux/usb/video.h>
#include "bytes.h"

enum { AE_MANUAL = 1, AE_APERTURE_PRIORITY = 8 };

/* Values of the request error code control (UVC 1.1, 4.2.1.2). */
enum {
	ERROR_NONE = 0,
	ERROR_WRONG_STATE = 2,
	ERROR_INVALID_CONTROL = 6,
	ERROR_INVALID_REQUEST = 7
};

enum control_index {
	AE_MODE,
	EXPOSURE,
	BRIGHTNESS,
	GAIN,
	POWER_LINE,
	WHITE,
	WHITE_AUTO,
	SHARPNESS,
	BACKLIGHT,
	CONTROLS
};

struct control {
	const char *name;
	uint8_t entity, selector, size_bytes;
	int minimum, maximum, step, initial;
};

static const struct control table[CONTROLS] = {
	/* For this bit map GET_RES tells the modes there are. */
	[AE_MODE] = {"ae_mode", CAMERA_TERMINAL, UVC_CT_AE_MODE_CONTROL, 1, AE_MANUAL,
		     AE_APERTURE_PRIORITY, AE_MANUAL | AE_APERTURE_PRIORITY, AE_APERTURE_PRIORITY},
	/* In 100 us. */
	[EXPOSURE] = {"exposure", CAMERA_TERMINAL, UVC_CT_EXPOSURE_TIME_ABSOLUTE_CONTROL, 4, 1,
		      2000, 1, 156},
	[BRIGHTNESS] = {"brightness", CAMERA_PROCESSING_UNIT, UVC_PU_BRIGHTNESS_CONTROL, 2, 0, 255,
			1, 128},
	/* In sixteenths. */
	[GAIN] = {"gain", CAMERA_PROCESSING_UNIT, UVC_PU_GAIN_CONTROL, 2, 16, 256, 1, 32},
	/* 0 off, 1 50 Hz, 2 60 Hz. */
	[POWER_LINE] = {"power_line", CAMERA_PROCESSING_UNIT, UVC_PU_POWER_LINE_FREQUENCY_CONTROL,
			1, 0, 2, 1, 2},
	/* In kelvin. */
	[WHITE] = {"white_balance", CAMERA_PROCESSING_UNIT,
		   UVC_PU_WHITE_BALANCE_TEMPERATURE_CONTROL, 2, 2800, 6500, 10, 4600},
	[WHITE_AUTO] = {"white_balance_auto", CAMERA_PROCESSING_UNIT,
			UVC_PU_WHITE_BALANCE_TEMPERATURE_AUTO_CONTROL, 1, 0, 1, 1, 1},
	[SHARPNESS] = {"sharpness", CAMERA_PROCESSING_UNIT, UVC_PU_SHARPNESS_CONTROL, 2, 0, 7, 1,
		       3},
	[BACKLIGHT] = {"backlight", CAMERA_PROCESSING_UNIT, UVC_PU_BACKLIGHT_COMPENSATION_CONTROL,
		       2, 0, 2, 1, 1},
};

enum { HISTORY = CAMERA_MAX_DELAY + 1 };

struct controls {
	const struct camera_options *options;
	struct faults *faults;
	pthread_mutex_t lock; /* of all below */
	int values[CONTROLS];
	int delay_frames;
	struct settings history[HISTORY]; /* settings in force when frame n began, at n % HISTORY */
	unsigned frame;
	uint8_t error; /* why the last request was refused */
};

static struct settings in_force(const struct controls *controls)
{
	const int *values = controls->values;

	if (values[AE_MODE] != AE_MANUAL)
		return (struct settings){.exposure_us = 100.0 * table[EXPOSURE].initial,
					 .gain = (double)table[GAIN].initial / table[GAIN].minimum};
	return (struct settings){.exposure_us = 100.0 * values[EXPOSURE],
				 .gain = (double)values[GAIN] / table[GAIN].minimum};
}

struct controls *controls_create(const struct camera_options *options, struct faults *faults)
{
	struct controls *controls = calloc(1, sizeof(*controls));

	if (!controls)
		return NULL;
	controls->options = options;
	controls->faults = faults;
	controls->delay_frames = options->delay_frames;
	pthread_mutex_init(&controls->lock, NULL);
	controls_power_on(controls);
	return controls;
}

void controls_power_on(struct controls *controls)
{
	pthread_mutex_lock(&controls->lock);
	for (int i = 0; i < CONTROLS; i++)
		controls->values[i] = table[i].initial;
	for (int i = 0; i < HISTORY; i++)
		controls->history[i] = in_force(controls);
	pthread_mutex_unlock(&controls->lock);
}

void controls_destroy(struct controls *controls)
{
	if (!controls)
		return;
	pthread_mutex_destroy(&controls->lock);
	free(controls);
}

static bool present(const struct controls *controls, int index)
{
	bool exposure = index == AE_MODE || index == EXPOSURE;

	return !exposure || controls->options->exposure != CAMERA_EXPOSURE_MISSING;
}

static int find(const struct controls *controls, const struct usb_ctrlrequest *request)
{
	int entity = request->wIndex >> 8;
	int selector = request->wValue >> 8;

	for (int i = 0; i < CONTROLS; i++)
		if (table[i].entity == entity && table[i].selector == selector &&
		    present(controls, i))
			return i;
	return -ENOENT;
}

static bool settable(const struct controls *controls, int index)
{
	bool exposure = index == AE_MODE || index == EXPOSURE;

	if (index == BACKLIGHT)
		return controls->options->exposure != CAMERA_EXPOSURE_READ_ONLY;
	return !exposure || controls->options->exposure == CAMERA_EXPOSURE_SETTABLE;
}

/* Is the control's value made by an automatic mode at present? */
static bool automatic(const struct controls *controls, int index)
{
	const int *values = controls->values;

	return (index == EXPOSURE && values[AE_MODE] != AE_MANUAL) ||
	       (index == WHITE && values[WHITE_AUTO]);
}

static uint8_t information(const struct controls *controls, int index)
{
	uint8_t info = UVC_CONTROL_CAP_GET;

	if (settable(controls, index))
		info |= UVC_CONTROL_CAP_SET;
	if (automatic(controls, index))
		info |= UVC_CONTROL_CAP_DISABLED;
	if (index == EXPOSURE || index == WHITE)
		info |= UVC_CONTROL_CAP_AUTOUPDATE;
	return info;
}

static int refuse(struct controls *controls, uint8_t reason)
{
	controls->error = reason;
	return -EPIPE;
}

static int answer(struct controls *controls, int index, uint8_t request, uint8_t *data)
{
	const struct control *control = &table[index];
	int value;

	switch (request) {
	case UVC_GET_INFO:
		data[0] = information(controls, index);
		return 1;
	case UVC_GET_LEN:
		put16(data, control->size_bytes);
		return 2;
	case UVC_GET_CUR:
		value = controls->values[index];
		break;
	case UVC_GET_MIN:
		value = control->minimum;
		break;
	case UVC_GET_MAX:
		value = control->maximum;
		break;
	case UVC_GET_RES:
		value = control->step;
		break;
	case UVC_GET_DEF:
		value = control->initial;
		break;
	default:
		return refuse(controls, ERROR_INVALID_REQUEST);
	}
	put32(data, (uint32_t)value);
	return control->size_bytes;
}

/* The interface itself, entity 0, has one control: why the last request was refused. */
static int answer_error_code(struct controls *controls, const struct usb_ctrlrequest *request,
			     uint8_t *data)
{
	if (request->wValue >> 8 != UVC_VC_REQUEST_ERROR_CODE_CONTROL)
		return refuse(controls, ERROR_INVALID_CONTROL);
	data[0] = request->bRequest == UVC_GET_INFO ? UVC_CONTROL_CAP_GET : controls->error;
	return 1;
}

int controls_get(struct controls *controls, const struct usb_ctrlrequest *request, uint8_t *data)
{
	int index, ret;

	pthread_mutex_lock(&controls->lock);
	index = find(controls, request);
	if (request->wIndex >> 8 == 0) {
		ret = answer_error_code(controls, request, data);
	} else if (index < 0) {
		ret = refuse(controls, ERROR_INVALID_CONTROL);
	} else {
		controls->error = ERROR_NONE;
		ret = answer(controls, index, request->bRequest, data);
	}
	pthread_mutex_unlock(&controls->lock);
	return ret;
}

int controls_may_set(struct controls *controls, const struct usb_ctrlrequest *request)
{
	int ret = 0;
	int index;

	pthread_mutex_lock(&controls->lock);
	controls->error = ERROR_NONE;
	index = find(controls, request);
	if (index < 0)
		ret = refuse(controls, ERROR_INVALID_CONTROL);
	else if (!settable(controls, index) || request->wLength != table[index].size_bytes)
		ret = refuse(controls, ERROR_INVALID_REQUEST);
	else if (automatic(controls, index))
		ret = refuse(controls, ERROR_WRONG_STATE);
	pthread_mutex_unlock(&controls->lock);
	return ret;
}

void controls_set(struct controls *controls, const struct usb_ctrlrequest *request,
		  const uint8_t *data)
{
	const struct control *control;
	int index, value;

	pthread_mutex_lock(&controls->lock);
	index = find(controls, request);
	control = &table[index];
	value = (int)get_le(data, control->size_bytes);
	if (value < control->minimum)
		value = control->minimum;
	if (value > control->maximum)
		value = control->maximum;
	controls->values[index] = value;
	pthread_mutex_unlock(&controls->lock);
}

struct settings controls_next_frame(struct controls *controls)
{
	struct settings now, *newest;

	pthread_mutex_lock(&controls->lock);
	newest = &controls->history[controls->frame % HISTORY];
	if (fault_is_on(controls->faults, FAULT_IGNORE_EXPOSURE))
		*newest = controls->history[(controls->frame + HISTORY - 1) % HISTORY];
	else
		*newest = in_force(controls);
	now = controls->history[(controls->frame + HISTORY - (unsigned)controls->delay_frames) %
				HISTORY];
	controls->frame++;
	pthread_mutex_unlock(&controls->lock);
	return now;
}

void controls_set_delay(struct controls *controls, int delay_frames)
{
	pthread_mutex_lock(&controls->lock);
	controls->delay_frames = delay_frames;
	pthread_mutex_unlock(&controls->lock);
}

int controls_value(struct controls *controls, const char *name)
{
	int value = -1;

	pthread_mutex_lock(&controls->lock);
	for (int i = 0; i < CONTROLS; i++)
		if (strcmp(table[i].name, name) == 0)
			value = controls->values[i];
	pthread_mutex_unlock(&controls->lock);
	return value;
}
