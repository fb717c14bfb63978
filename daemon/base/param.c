/* SPDX-License-Identifier: Apache-2.0 */
#include "base/param.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"

static int parse_bool(const char *text, bool *value)
{
	static const char *const words[] = {"0", "1", "no", "yes", "off", "on", "false", "true"};

	for (size_t i = 0; i < LP_COUNT(words); i++) {
		if (strcmp(text, words[i]) == 0) {
			*value = i % 2;
			return 0;
		}
	}
	return -EINVAL;
}

/* A finite number within the bounds, and what follows it. */
static int parse_number(const struct lp_param *param, const char *text, const char **end,
			double *value)
{
	char *after;

	if (*text == ' ' || *text == '\t') /* strtod would skip it */
		return -EINVAL;
	*value = strtod(text, &after);
	*end = after;
	if (after == text || !isfinite(*value) || *value < param->min || *value > param->max)
		return -EINVAL;
	return 0;
}

/* A whole number within the bounds, to this base. */
static int parse_int(const struct lp_param *param, const char *text, int base, int *value)
{
	char *end;
	long number;

	if (*text == ' ' || *text == '\t')
		return -EINVAL;
	errno = 0;
	number = strtol(text, &end, base);
	if (errno || end == text || *end || (double)number < param->min ||
	    (double)number > param->max)
		return -EINVAL;
	*value = (int)number;
	return 0;
}

static int parse_float(const struct lp_param *param, const char *text, float *value)
{
	const char *end;
	double number;

	if (parse_number(param, text, &end, &number) < 0 || *end)
		return -EINVAL;
	*value = (float)number;
	return 0;
}

static int parse_floats(const struct lp_param *param, const char *text, struct lp_floats *list)
{
	struct lp_floats parsed = {0};
	double number;

	for (;; text++) {
		text += strspn(text, " ");
		if (parsed.count == LP_PARAM_FLOATS_MAX ||
		    parse_number(param, text, &text, &number) < 0)
			return -EINVAL;
		parsed.values[parsed.count++] = (float)number;
		text += strspn(text, " ");
		if (!*text)
			break;
		if (*text != ',')
			return -EINVAL;
	}
	*list = parsed;
	return 0;
}

static int parse_size(const struct lp_param *param, const char *text, struct lp_size *size)
{
	const struct lp_param side = {.min = 1, .max = param->max};
	char width_text[16];
	const char *cross = strchr(text, 'x');
	int width, height;

	if (!cross || (size_t)(cross - text) >= sizeof(width_text))
		return -EINVAL;
	memcpy(width_text, text, (size_t)(cross - text));
	width_text[cross - text] = '\0';
	if (parse_int(&side, width_text, 10, &width) < 0 ||
	    parse_int(&side, cross + 1, 10, &height) < 0)
		return -EINVAL;
	*size = (struct lp_size){.width = (uint32_t)width, .height = (uint32_t)height};
	return 0;
}

static int parse_text(const struct lp_param *param, const char *text, char *field)
{
	const size_t length = strlen(text);

	if (length >= (size_t)param->max)
		return -EINVAL;
	memcpy(field, text, length + 1);
	return 0;
}

static int parse_choice(const struct lp_param *param, const char *text, int *value)
{
	for (int i = 0; param->choices[i]; i++) {
		if (strcmp(text, param->choices[i]) == 0) {
			*value = i;
			return 0;
		}
	}
	return -EINVAL;
}

static int parse(const struct lp_param *param, const char *text, void *field)
{
	switch (param->type) {
	case LP_PARAM_BOOL:
		return parse_bool(text, field);
	case LP_PARAM_INT:
		return parse_int(param, text, 10, field);
	case LP_PARAM_HEX:
		return parse_int(param, text, strncmp(text, "0x", 2) ? 10 : 16, field);
	case LP_PARAM_FLOAT:
		return parse_float(param, text, field);
	case LP_PARAM_FLOATS:
		return parse_floats(param, text, field);
	case LP_PARAM_SIZE:
		return parse_size(param, text, field);
	case LP_PARAM_TEXT:
		return parse_text(param, text, field);
	case LP_PARAM_CHOICE:
		return parse_choice(param, text, field);
	case LP_PARAM_OWN:
		return param->parse(text, field);
	}
	return -EINVAL;
}

/* Append to `text`, never past its end. */
__attribute__((format(printf, 3, 4))) static void append(char *text, size_t size_bytes,
							 const char *format, ...)
{
	const size_t used = strlen(text);
	va_list arguments;

	va_start(arguments, format);
	(void)vsnprintf(text + used, size_bytes - used, format, arguments);
	va_end(arguments);
}

/* What the parameter expects, in words ("a whole number 0..4"), into `text`. */
static void describe(const struct lp_param *param, char *text, size_t size_bytes)
{
	text[0] = '\0';
	switch (param->type) {
	case LP_PARAM_BOOL:
		append(text, size_bytes, "0 or 1");
		break;
	case LP_PARAM_INT:
		append(text, size_bytes, "a whole number %.0f..%.0f", param->min, param->max);
		break;
	case LP_PARAM_HEX:
		append(text, size_bytes, "a number 0x%02x..0x%02x", (int)param->min,
		       (int)param->max);
		break;
	case LP_PARAM_FLOAT:
		append(text, size_bytes, "a number %g..%g", param->min, param->max);
		break;
	case LP_PARAM_FLOATS:
		append(text, size_bytes, "up to %d numbers %g..%g, separated by commas",
		       LP_PARAM_FLOATS_MAX, param->min, param->max);
		break;
	case LP_PARAM_SIZE:
		append(text, size_bytes, "WIDTHxHEIGHT in pixels, at most %.0f each", param->max);
		break;
	case LP_PARAM_TEXT:
		append(text, size_bytes, "text of at most %.0f bytes", param->max - 1);
		break;
	case LP_PARAM_CHOICE:
		for (int i = 0; param->choices[i]; i++)
			append(text, size_bytes, "%s%s", i ? "|" : "", param->choices[i]);
		break;
	case LP_PARAM_OWN:
		append(text, size_bytes, "%s", param->expects);
		break;
	}
}

const struct lp_param *lp_param_find(const struct lp_params *params, const char *name)
{
	for (; params; params = params->more) {
		for (size_t i = 0; i < params->count; i++) {
			if (strcmp(params->list[i].name, name) == 0)
				return &params->list[i];
		}
	}
	return NULL;
}

/* "rate, loop" */
static void list_names(const struct lp_params *params, char *text, size_t size_bytes)
{
	text[0] = '\0';
	for (; params; params = params->more) {
		for (size_t i = 0; i < params->count; i++)
			append(text, size_bytes, "%s%s", *text ? ", " : "", params->list[i].name);
	}
	if (!*text)
		append(text, size_bytes, "(none)");
}

int lp_param_set(const struct lp_params *params, void *fields, const char *object, const char *name,
		 const char *value)
{
	const struct lp_param *param = lp_param_find(params, name);
	char text[384];

	if (!param) {
		list_names(params, text, sizeof(text));
		lp_error(object, name, "unknown key; known: %s", text);
		return -EINVAL;
	}
	if (parse(param, value, (char *)fields + param->offset) < 0) {
		describe(param, text, sizeof(text));
		lp_error(object, name, "'%s' is not %s", value, text);
		return -EINVAL;
	}
	return 0;
}

void lp_param_defaults(const struct lp_params *params, void *fields)
{
	for (; params; params = params->more) {
		for (size_t i = 0; i < params->count; i++) {
			const struct lp_param *param = &params->list[i];

			if (param->initial &&
			    parse(param, param->initial, (char *)fields + param->offset) < 0) {
				lp_error(param->name, "default", "'%s' does not parse",
					 param->initial);
				abort();
			}
		}
	}
}

/* ---------------------------------------------------------------- help */

void lp_print_indented(FILE *out, int indent, const char *text)
{
	while (*text) {
		const size_t length = strcspn(text, "\n");

		(void)fprintf(out, "%*s%.*s\n", indent, "", (int)length, text);
		text += length + (text[length] != '\0');
	}
}

static void print_one(FILE *out, const char *lead, const struct lp_param *param)
{
	char expects[256];

	describe(param, expects, sizeof(expects));
	(void)fprintf(out, "%s%s=%s   (%s)\n", lead, param->name,
		      param->initial ? param->initial : "", expects);
	lp_print_indented(out, (int)strspn(lead, " ") + 4, param->help);
}

void lp_param_print(FILE *out, const char *lead, const struct lp_params *params)
{
	for (; params; params = params->more) {
		for (size_t i = 0; i < params->count; i++)
			print_one(out, lead, &params->list[i]);
	}
}
