/* SPDX-License-Identifier: Apache-2.0 */
#include "base/ini.h"

#include <errno.h>
#include <ini.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/param.h"

#define OBJECT_BYTES (PATH_MAX + 16)

/* libinih tells its handler no line numbers: they are counted where the lines are handed to it. */
struct reader {
	struct lp_ini *ini;
	const char *text;
	size_t left_bytes;
	int line;
	int ret; /* the first error; it has been logged */
};

static const char *object_of(const struct lp_ini *ini, int line, char object[OBJECT_BYTES])
{
	(void)snprintf(object, OBJECT_BYTES, "%s:%d", ini->path, line);
	return object;
}

/* ---------------------------------------------------------------- lines for libinih */

/* Bytes of a line without its end, a comment, and the blanks before them. */
static size_t content_bytes(const char *line, size_t length)
{
	bool after_blank = true;
	size_t end = 0;

	for (size_t i = 0; i < length; i++) {
		const bool blank = strchr(" \t\r\n", line[i]) && line[i];

		if (after_blank && (line[i] == '#' || line[i] == ';'))
			break;
		after_blank = blank;
		if (!blank)
			end = i + 1;
	}
	return end;
}

static void refuse_line(struct reader *reader, const char *reason)
{
	char object[OBJECT_BYTES];

	if (reader->ret == 0)
		lp_error(object_of(reader->ini, reader->line, object), "parse", "%s", reason);
	reader->ret = -EBADMSG;
}

/*
 * libinih's fgets(): one whole line. Without indentation, which libinih would take for a
 * continuation of the line before; without comments, so that these may be of any length.
 */
static char *next_line(char *line, int size_bytes, void *stream)
{
	struct reader *reader = stream;
	const char *begin = reader->text;
	const char *newline = memchr(begin, '\n', reader->left_bytes);
	size_t length = newline ? (size_t)(newline - begin) + 1 : reader->left_bytes;

	if (length == 0 || reader->ret < 0)
		return NULL;
	reader->text += length;
	reader->left_bytes -= length;
	reader->line++;
	for (; length > 0 && (*begin == ' ' || *begin == '\t'); length--)
		begin++;
	length = content_bytes(begin, length);
	if (memchr(begin, '\0', length)) {
		refuse_line(reader, "contains a zero byte — is it a text file?");
		length = 0;
	} else if (length > LP_INI_LINE_MAX_BYTES || length >= (size_t)size_bytes) {
		char reason[64];

		(void)snprintf(reason, sizeof(reason), "a line has at most %d bytes, this one %zu",
			       LP_INI_LINE_MAX_BYTES, length);
		refuse_line(reader, reason);
		length = 0;
	}
	memcpy(line, begin, length);
	line[length] = '\0';
	return line;
}

/* libinih's handler: 1 means well. */
static int add_entry(void *context, const char *section, const char *name, const char *value)
{
	struct reader *reader = context;
	struct lp_ini *ini = reader->ini;
	struct lp_ini_entry *entries =
		realloc(ini->entries, (size_t)(ini->count + 1) * sizeof(*entries));
	struct lp_ini_entry *entry;

	if (!entries)
		goto err_memory;
	ini->entries = entries;
	entry = &entries[ini->count];
	*entry = (struct lp_ini_entry){.section = strdup(section),
				       .name = strdup(name),
				       .value = strdup(value),
				       .line = reader->line};
	ini->count++;
	if (entry->section && entry->name && entry->value)
		return 1;
err_memory:
	reader->ret = -ENOMEM;
	return 0;
}

/* ---------------------------------------------------------------- reading */

static int out_of_memory(const char *path)
{
	lp_error(path, "read", "out of memory");
	return -ENOMEM;
}

int lp_ini_parse(struct lp_ini *ini, const char *path, const char *text, size_t size_bytes)
{
	struct reader reader = {.ini = ini, .text = text, .left_bytes = size_bytes};
	int wrong_line;

	*ini = (struct lp_ini){.path = strdup(path)};
	if (!ini->path)
		return out_of_memory(path);
	wrong_line = ini_parse_stream(next_line, &reader, add_entry, &reader);
	if (wrong_line > 0 && reader.ret == 0) {
		reader.line = wrong_line;
		refuse_line(&reader, "neither NAME = VALUE nor a # comment");
	}
	if (wrong_line < 0 || reader.ret == -ENOMEM)
		reader.ret = out_of_memory(path);
	if (reader.ret < 0)
		lp_ini_finish(ini);
	return reader.ret;
}

int lp_ini_read(struct lp_ini *ini, const char *path, const char *next_step)
{
	char *text = malloc(LP_INI_MAX_BYTES + 1);
	FILE *file = fopen(path, "re");
	size_t size_bytes = 0;
	int ret = 0;

	*ini = (struct lp_ini){0};
	if (!file)
		ret = -errno;
	else if (!text)
		ret = -ENOMEM;
	if (ret == 0) {
		size_bytes = fread(text, 1, LP_INI_MAX_BYTES + 1, file);
		if (ferror(file))
			ret = -errno;
		else if (size_bytes > LP_INI_MAX_BYTES)
			ret = -EFBIG;
	}
	if (ret < 0)
		lp_error(path, "read", "%s — %s", lp_strerror(ret), next_step);
	else
		ret = lp_ini_parse(ini, path, text, size_bytes);
	if (file)
		(void)fclose(file);
	free(text);
	return ret;
}

void lp_ini_finish(struct lp_ini *ini)
{
	for (int i = 0; i < ini->count; i++) {
		free(ini->entries[i].section);
		free(ini->entries[i].name);
		free(ini->entries[i].value);
	}
	free(ini->entries);
	free(ini->path);
	*ini = (struct lp_ini){0};
}

/* ---------------------------------------------------------------- what is in it */

static bool is_among(const char *text, const char *const *texts)
{
	while (*texts && strcmp(text, *texts) != 0)
		texts++;
	return *texts;
}

int lp_ini_check_sections(const struct lp_ini *ini, const char *const *known)
{
	char object[OBJECT_BYTES], list[256] = "(none)";
	size_t used = 0;

	for (int i = 0; i < ini->count; i++) {
		const struct lp_ini_entry *entry = &ini->entries[i];

		if (is_among(entry->section, known))
			continue;
		for (; *known && used < sizeof(list); known++) {
			if (**known)
				used += (size_t)snprintf(list + used, sizeof(list) - used, "%s[%s]",
							 used ? ", " : "", *known);
		}
		if (*entry->section)
			lp_error(object_of(ini, entry->line, object), "parse",
				 "unknown section [%s]; known: %s", entry->section, list);
		else
			lp_error(object_of(ini, entry->line, object), "parse",
				 "%s is set before the first section — known sections: %s",
				 entry->name, list);
		return -EBADMSG;
	}
	return 0;
}

bool lp_ini_has(const struct lp_ini *ini, const char *section)
{
	for (int i = 0; i < ini->count; i++) {
		if (strcmp(ini->entries[i].section, section) == 0)
			return true;
	}
	return false;
}

int lp_ini_set(const struct lp_ini *ini, const char *section, const struct lp_params *params,
	       void *fields)
{
	char object[OBJECT_BYTES];

	for (int i = 0; i < ini->count; i++) {
		const struct lp_ini_entry *entry = &ini->entries[i];

		if (strcmp(entry->section, section) == 0 &&
		    lp_param_set(params, fields, object_of(ini, entry->line, object), entry->name,
				 entry->value) < 0)
			return -EBADMSG;
	}
	return 0;
}
