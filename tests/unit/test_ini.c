/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <stdio.h>

#include "base/ini.h"
#include "base/param.h"

struct fields {
	int width;
	char name[32];
};

static const struct lp_param list[] = {
	{"width", LP_PARAM_INT, offsetof(struct fields, width), .min = 1, .max = 999},
	{"name", LP_PARAM_TEXT, offsetof(struct fields, name), .max = 32},
};
static const struct lp_params params = LP_PARAMS(list), only_name = {list + 1, 1, NULL};

/* Each text has a name of its own: the log counts what it has said of a place before. */
static int parse_as(const char *path, struct lp_ini *ini, const char *text)
{
	return lp_ini_parse(ini, path, text, strlen(text));
}

static int parse(struct lp_ini *ini, const char *text)
{
	return parse_as("a.ini", ini, text);
}

static void assert_entry(const struct lp_ini *ini, int i, int line, const char *section,
			 const char *name, const char *value)
{
	assert_true(i < ini->count);
	assert_int_equal(ini->entries[i].line, line);
	assert_string_equal(ini->entries[i].section, section);
	assert_string_equal(ini->entries[i].name, name);
	assert_string_equal(ini->entries[i].value, value);
}

static void test_entries_know_their_lines(void **state)
{
	struct lp_ini ini;

	(void)state;
	assert_int_equal(parse(&ini, "\xEF\xBB\xBF# a comment\n"
				     "before = all sections\r\n"
				     "\n"
				     "[one]\n"
				     "   indented = is no continuation\n"
				     "remark = value   # of a line\n"
				     "other: value\t; of a line\n"
				     "uri = file:a#b;c?d=1 ;remark\n"
				     "[two]\n"
				     "empty =\n"
				     "last = without a line's end"),
			 0);
	assert_int_equal(ini.count, 7);
	assert_entry(&ini, 0, 2, "", "before", "all sections");
	assert_entry(&ini, 1, 5, "one", "indented", "is no continuation");
	assert_entry(&ini, 2, 6, "one", "remark", "value");
	assert_entry(&ini, 3, 7, "one", "other", "value");
	assert_entry(&ini, 4, 8, "one", "uri", "file:a#b;c?d=1");
	assert_entry(&ini, 5, 10, "two", "empty", "");
	assert_entry(&ini, 6, 11, "two", "last", "without a line's end");
	assert_true(lp_ini_has(&ini, "two"));
	assert_false(lp_ini_has(&ini, "three"));
	lp_ini_finish(&ini);
	lp_ini_finish(&ini); /* holds nothing any more */
}

/* Tails of comments and values once became settings of their own. */
static void test_a_long_line_is_an_error_and_a_long_comment_is_none(void **state)
{
	char text[1024];
	struct capture capture;
	struct lp_ini ini;

	(void)state;
	(void)snprintf(text, sizeof(text), "[a]\n# %0197dwidth = 7\nwidth = 3 ; %0300d\n", 0, 0);
	assert_int_equal(parse(&ini, text), 0);
	assert_int_equal(ini.count, 1);
	assert_entry(&ini, 0, 3, "a", "width", "3");
	lp_ini_finish(&ini);
	(void)snprintf(text, sizeof(text), "name = %0191d\n", 0); /* 198 bytes */
	assert_int_equal(parse(&ini, text), 0);
	assert_int_equal(strlen(ini.entries[0].value), 191);
	lp_ini_finish(&ini);
	(void)snprintf(text, sizeof(text), "[a]\nname = %0192dwidth = 7\n", 0);
	capture_begin(&capture);
	assert_int_equal(parse(&ini, text), -EBADMSG);
	capture_end(&capture);
	assert_string_equal(capture.text, "error a.ini:2: parse: a line has at most 198 bytes, "
					  "this one 208\n");
}

static void test_what_is_no_ini_file(void **state)
{
	static const char zero[] = "[a]\nwidth = 1\0\n";
	struct capture capture;
	struct lp_ini ini;

	(void)state;
	capture_begin(&capture);
	assert_int_equal(parse_as("c.ini", &ini, "[a]\nwidth 3\nwidth = 4\n"), -EBADMSG);
	assert_int_equal(lp_ini_parse(&ini, "b.ini", zero, sizeof(zero) - 1), -EBADMSG);
	assert_int_equal(lp_ini_read(&ini, "/nonexistent", "check --config"), -ENOENT);
	assert_int_equal(lp_ini_read(&ini, "/dev/zero", "check --config"), -EFBIG);
	capture_end(&capture);
	assert_string_equal(capture.text,
			    "error c.ini:2: parse: neither NAME = VALUE nor a # comment\n"
			    "error b.ini:2: parse: contains a zero byte — is it a text file?\n"
			    "error /nonexistent: read: No such file or directory — check --config\n"
			    "error /dev/zero: read: File too large — check --config\n");
}

static void test_sections_and_values_are_checked(void **state)
{
	static const char *const known[] = {"a", "b", NULL};
	static const char *const none[] = {"", NULL};
	struct fields fields = {0};
	struct capture capture;
	struct lp_ini ini;

	(void)state;
	assert_int_equal(parse_as("d.ini", &ini, "[a]\nwidth = 5\nname = x\n[b]\nwidth = 6\n"), 0);
	assert_int_equal(lp_ini_check_sections(&ini, known), 0);
	assert_int_equal(lp_ini_set(&ini, "a", &params, &fields), 0);
	assert_int_equal(fields.width, 5);
	assert_string_equal(fields.name, "x");
	capture_begin(&capture);
	assert_int_equal(lp_ini_check_sections(&ini, known + 1), -EBADMSG);
	assert_int_equal(lp_ini_set(&ini, "b", &only_name, &fields), -EBADMSG);
	lp_ini_finish(&ini);
	assert_int_equal(parse_as("e.ini", &ini, "[a]\nwidth = 5\n"), 0);
	assert_int_equal(lp_ini_check_sections(&ini, none), -EBADMSG);
	lp_ini_finish(&ini);
	assert_int_equal(parse_as("f.ini", &ini, "\nwidth = 1000\n"), 0);
	assert_int_equal(lp_ini_check_sections(&ini, known), -EBADMSG);
	assert_int_equal(lp_ini_set(&ini, "", &params, &fields), -EBADMSG);
	lp_ini_finish(&ini);
	capture_end(&capture);
	assert_string_equal(capture.text,
			    "error d.ini:2: parse: unknown section [a]; known: [b]\n"
			    "error d.ini:5: width: unknown key; known: name\n"
			    "error e.ini:2: parse: unknown section [a]; known: (none)\n"
			    "error f.ini:2: parse: width is set before the first section — known "
			    "sections: [a], [b]\n"
			    "error f.ini:2: width: '1000' is not a whole number 1..999\n");
	assert_int_equal(fields.width, 5);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_entries_know_their_lines),
		cmocka_unit_test(test_a_long_line_is_an_error_and_a_long_comment_is_none),
		cmocka_unit_test(test_what_is_no_ini_file),
		cmocka_unit_test(test_sections_and_values_are_checked),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
