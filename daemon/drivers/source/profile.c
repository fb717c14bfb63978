/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/profile.h"

#include <errno.h>
#include <ini.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "base/uri.h"

#define MOST_PX 16384
#define HEX_DIGITS "0123456789abcdefABCDEF"
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define FIELD(name) offsetof(struct lp_profile, name)

size_t lp_usb_id_parse(const char *text, struct lp_usb_id *id)
{
	int length = 0;

	if (strspn(text, HEX_DIGITS) != 4 ||
	    sscanf(text, "%4hx:%4hx%n", &id->vendor, &id->product, &length) != 2 || length != 9)
		return 0;
	id->known = true;
	return (size_t)length;
}

static int parse_match(const char *text, void *field)
{
	const bool usb = !strncmp(text, "usb:", 4);

	return usb && lp_usb_id_parse(text + 4, field) == strlen(text + 4) ? 0 : -EINVAL;
}

/* inih tells no line to its handler: count them where it reads. */
struct reading {
	const char *path;
	FILE *stream;
	int line;
	bool explained; /* the error has been logged */
	const struct lp_profile_table *table;
	struct lp_profile *profile;
};

static char *read_line(char *text, int size, void *context)
{
	struct reading *reading = context;

	reading->line++;
	return fgets(text, size, reading->stream);
}

static int set_camera_field(struct lp_profile *profile, const char *object, const char *name,
			    const char *value)
{
	static const struct lp_param params[] = {
		{"width_px", LP_PARAM_INT, FIELD(size_px.width), .min = 1, .max = MOST_PX},
		{"height_px", LP_PARAM_INT, FIELD(size_px.height), .min = 1, .max = MOST_PX},
		{"match", LP_PARAM_OWN, FIELD(usb), .parse = parse_match,
		 .expects = "usb:VENDOR:PRODUCT, four hexadecimal digits each"},
	};

	if (!lp_param_find(params, COUNT(params), name))
		return 0;
	return lp_param_set(params, COUNT(params), profile, object, name, value);
}

static int on_field(void *context, const char *section, const char *name, const char *value)
{
	struct reading *reading = context;
	const struct lp_profile_table *table = reading->table;
	char object[512];
	int ret = 0;

	snprintf(object, sizeof(object), "%s:%d", reading->path, reading->line);
	if (!strcmp(section, table->section))
		ret = lp_param_set(table->params, table->count, table->fields, object, name, value);
	else if (!strcmp(section, "camera"))
		ret = set_camera_field(reading->profile, object, name, value);
	reading->explained |= ret < 0;
	return ret == 0;
}

static int read_file(const char *path, const struct lp_profile_table *table,
		     struct lp_profile *profile)
{
	struct reading reading = {.path = path, .table = table, .profile = profile};
	int line;

	reading.stream = fopen(path, "re");
	if (!reading.stream) {
		const int ret = -errno;

		lp_error(path, "camera file", "%s", lp_strerror(ret));
		return ret;
	}
	line = ini_parse_stream(read_line, &reading, on_field, &reading);
	fclose(reading.stream);
	if (line == 0)
		return 0;
	if (!reading.explained)
		lp_error(path, "camera file", "line %d is neither [section] nor name = value",
			 line);
	return -EBADMSG;
}

int lp_profile_read(const struct lp_uri *uri, const char *camera,
		    const struct lp_profile_table *table, struct lp_profile *profile)
{
	int ret;

	*profile = (struct lp_profile){0};
	lp_param_defaults(table->params, table->count, table->fields);
	if (camera && strcmp(camera, "equirect") != 0) {
		ret = read_file(camera, table, profile);
		if (ret < 0)
			return ret;
	}
	for (int i = 0; i < uri->key_count; i++) {
		ret = lp_param_set(table->params, table->count, table->fields, uri->text,
				   uri->keys[i].name, uri->keys[i].value);
		if (ret < 0)
			return ret;
	}
	return 0;
}
