/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/processing.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "base/text.h"

const char *const lp_processing_wishes[] = {"neutral", "keep", NULL};

/* Append to a list that commas separate. */
static void append(char *text, const char *format, va_list arguments)
{
	char item[LP_PROCESSING_TEXT_BYTES], whole[2 * LP_PROCESSING_TEXT_BYTES + 2];

	(void)vsnprintf(item, sizeof(item), format, arguments);
	(void)snprintf(whole, sizeof(whole), "%s%s%s", text, *text ? ", " : "", item);
	lp_text_copy(text, LP_PROCESSING_TEXT_BYTES, whole);
}

void lp_processing_off(struct lp_processing_report *report, const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	append(report->off_text, format, arguments);
	va_end(arguments);
}

void lp_processing_on(struct lp_processing_report *report, enum lp_processing kind,
		      const char *format, ...)
{
	va_list arguments;

	report->on |= LP_PROCESSING_BIT(kind);
	va_start(arguments, format);
	append(report->on_text, format, arguments);
	va_end(arguments);
}

void lp_processing_tell(const struct lp_processing_report *report, bool keep,
			struct lp_processing_report *told, const char *object)
{
	if (strcmp(report->off_text, told->off_text) != 0 && *report->off_text)
		lp_info(object, "processing", "switched off: %s", report->off_text);
	if (strcmp(report->on_text, told->on_text) != 0 && *report->on_text) {
		if (keep)
			lp_info(object, "processing", "kept, as processing=keep says: %s",
				report->on_text);
		else
			lp_warning(object, "processing",
				   "stays on, and alters the light: %s — see "
				   "docs/users/cameras.md",
				   report->on_text);
	}
	*told = *report;
}
