/* SPDX-License-Identifier: Apache-2.0 */
/* The osc source in its parts: address and password, multipart streams, answers of cameras. */
#include "lp_test.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "drivers/source/osc/multipart.h"
#include "drivers/source/osc/reply.h"
#include "drivers/source/osc/settings.h"

/* ---------------------------------------------------------------- address and password */

static void test_addresses(void **state)
{
	static const struct {
		const char *text, *host;
		int port;
	} good[] = {
		{"192.168.1.1", "192.168.1.1", 80},
		{"theta.local:8080", "theta.local", 8080},
		{"[fe80::1%eth0]:81", "[fe80::1%eth0]", 81},
		{"[::1]", "[::1]", 80},
	};
	static const char *const bad[] = {"",		":80",	   "host:", "host:0",
					  "host:65536", "host:8x", "ho/st", "user@host",
					  "host name",	"fe80::1", "[::1",  "host:-1"};
	struct lp_osc_settings settings;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(good); i++) {
		assert_int_equal(lp_osc_address_parse(good[i].text, &settings), 0);
		assert_string_equal(settings.host, good[i].host);
		assert_int_equal(settings.port, good[i].port);
	}
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		if (lp_osc_address_parse(bad[i], &settings) == 0)
			fail_msg("'%s' is taken for %s:%d", bad[i], settings.host, settings.port);
	}
}

static int read_login(const char *text, mode_t mode, struct lp_osc_login *login, const char *says)
{
	char path[] = "/tmp/lp-osc-login-XXXXXX";
	const int fd = mkstemp(path);
	struct capture capture;
	int ret;

	assert_true(fd >= 0);
	assert_int_equal(write(fd, text, strlen(text)), strlen(text));
	assert_int_equal(fchmod(fd, mode), 0);
	close(fd);
	capture_begin(&capture);
	ret = lp_osc_login_read(path, login);
	assert_non_null(strstr(capture_end(&capture), says));
	unlink(path);
	return ret;
}

static void test_passwords(void **state)
{
	struct lp_osc_login login;

	(void)state;
	assert_int_equal(read_login("THETAYN1:pass:word\nmore\n", 0600, &login, ""), 0);
	assert_string_equal(login.user, "THETAYN1");
	assert_string_equal(login.password, "pass:word");
	assert_int_equal(read_login("u:p", 0644, &login, "chmod 600"), -EACCES);
	assert_int_equal(read_login("nothing", 0600, &login, "expected USER:PASSWORD"), -EBADMSG);
	assert_int_equal(read_login(":p\n", 0600, &login, "expected USER:PASSWORD"), -EBADMSG);
	assert_int_equal(read_login("", 0600, &login, "expected USER:PASSWORD"), -EBADMSG);
}

/* ---------------------------------------------------------------- multipart */

static struct {
	uint8_t buffer[4096];
	char parts[4096]; /* that ended, each followed by '|' */
	bool no_room;
} sink;

static uint8_t *reserve(void *context, size_t size_bytes)
{
	(void)context;
	assert_true(size_bytes <= sizeof(sink.buffer));
	return sink.no_room ? NULL : sink.buffer;
}

/* Here a whole picture is one that begins with '<'; like a JPEG it ends with FF D9. */
static bool is_whole(void *context, const uint8_t *data, size_t size_bytes)
{
	(void)context;
	return size_bytes > 2 && data[0] == '<';
}

static void on_part(void *context, size_t size_bytes)
{
	const size_t used = strlen(sink.parts);

	(void)context;
	for (size_t i = 0; i < size_bytes; i++) /* readable */
		sink.parts[used + i] = sink.buffer[i] == 0xff	? '('
				       : sink.buffer[i] == 0xd9 ? ')'
								: (char)sink.buffer[i];
	sink.parts[used + size_bytes] = '|';
	sink.parts[used + size_bytes + 1] = '\0';
}

#define END "\xff\xd9"
#define LINE "--b0undary\r\nContent-type: image/jpeg\r\n"

static const char *split_as(const char *type, const char *stream, size_t piece_bytes)
{
	const struct lp_multipart_sink where = {NULL, reserve, is_whole, on_part};
	const size_t length = strlen(stream);
	struct lp_multipart multipart;

	sink.parts[0] = '\0';
	assert_int_equal(lp_multipart_init(&multipart, type, &where), 0);
	for (size_t at = 0; at < length; at += piece_bytes)
		lp_multipart_feed(&multipart, (const uint8_t *)stream + at,
				  at + piece_bytes < length ? piece_bytes : length - at);
	return sink.parts;
}

static const char *split(const char *stream, size_t piece_bytes)
{
	return split_as("multipart/x-mixed-replace; boundary=\"b0undary\"", stream, piece_bytes);
}

/* However it is cut, and whatever the length says. The last one ends when it is whole. */
static void test_parts_however_they_are_cut(void **state)
{
	static const struct {
		const char *stream, *parts;
	} cases[] = {
		{LINE "Content-Length: 5\r\n\r\n<ab" END "\r\n" LINE
		      "Content-Length: 4\r\n\r\n<c" END "\r\n",
		 "<ab()|<c()|"},
		/* no length; the dashes are missing */
		{"b0undary\r\n\r\n<ab" END "\r\nb0undary\r\n\r\n<c" END, "<ab()|<c()|"},
		/* too short, too long, no number, negative, huge */
		{LINE "Content-Length: 2\r\n\r\n<ab" END "\r\n" LINE "\r\n<c" END, "<ab()|<c()|"},
		{LINE "Content-Length: 99\r\n\r\n<ab" END "\r\n" LINE "\r\n<c" END, "<ab()|<c()|"},
		{LINE "Content-Length: x\r\n\r\n<ab" END "\r\n" LINE "\r\n<c" END, "<ab()|<c()|"},
		{LINE "Content-Length: -7\r\n\r\n<ab" END "\r\n" LINE "\r\n<c" END, "<ab()|<c()|"},
		{LINE "Content-Length: 99999999999999999999\r\n\r\n<a" END LINE "\r\n<c" END,
		 "<a()|<c()|"},
		/* cut off: it ends with the boundary */
		{LINE "Content-Length: 9\r\n\r\n<ab\r\n" LINE "\r\n<c" END, "<ab|<c()|"},
		/* what looks like the end is none: the picture is not whole */
		{LINE "\r\nab" END "cd\r\n" LINE "\r\n<c" END, "ab()cd|<c()|"},
		/* a preamble, an epilogue, a line without end */
		{"hello\r\n\r\n" LINE "\r\n<c" END "\r\n--b0undary--\r\n", "<c()|"},
	};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		for (size_t piece = 1; piece <= strlen(cases[i].stream); piece++) {
			const char *parts = split(cases[i].stream, piece);

			if (strcmp(parts, cases[i].parts) != 0)
				fail_msg("case %zu in pieces of %zu: '%s'", i, piece, parts);
		}
	}
}

/* Everything that RFC 2046 and RFC 2045 allow around and in a boundary; two pictures each. */
static void test_every_legal_framing(void **state)
{
	static const struct {
		const char *type, *stream;
	} cases[] = {
		/* blanks behind the boundary; blanks around the parameter; other parameters */
		{"multipart/mixed;boundary=ab",
		 "--ab \r\n\r\n<a\r\n--ab \t \r\n\r\n<b\r\n--ab--  \r\n"},
		{"multipart/mixed ; charset=x; boundary = ab ; y=z",
		 "--ab\r\n\r\n<a\r\n--ab\r\n\r\n<b\r\n--ab--"},
		{"multipart/mixed; x=\"; boundary=no\"; boundary=ab",
		 "--ab\r\n\r\n<a\r\n--ab\r\n\r\n<b\r\n--ab--"},
		{"multipart/mixed; xboundary=no; boundary=ab",
		 "--ab\r\n\r\n<a\r\n--ab\r\n\r\n<b\r\n--ab--"},
		/* a boundary of one byte, which pictures have in them; of dashes; of all that it
		   may have */
		{"multipart/mixed; boundary=b", "--b\r\n\r\n<a\r\n--b\r\n\r\n<b\r\n--b--"},
		{"multipart/mixed; boundary=--", "----\r\n\r\n<a\r\n----\r\n\r\n<b\r\n------"},
		{"multipart/mixed; boundary=\"a b\\c'()+_,-./:=?\"",
		 "--a bc'()+_,-./:=?\r\n\r\n<a\r\n--a bc'()+_,-./:=?\r\n\r\n<b\r\n--a "
		 "bc'()+_,-./:=?--"},
		{"multipart/mixed; "
		 "boundary=0123456789012345678901234567890123456789012345678901234567890123456789",
		 "--0123456789012345678901234567890123456789012345678901234567890123456789\r\n\r\n<"
		 "a\r\n"
		 "--0123456789012345678901234567890123456789012345678901234567890123456789\r\n\r\n<"
		 "b\r\n"
		 "--0123456789012345678901234567890123456789012345678901234567890123456789--"},
		/* text before and behind, which mentions the boundary and has a header's look */
		{"multipart/mixed; boundary=ab",
		 "ab is next\r\n\r\nContent-Length: "
		 "1\r\n--abc\r\n--ab\r\n\r\n<a\r\n--ab\r\n\r\n<b\r\n--ab--\r\n\r\n<c\r\n"},
		/* headers in any case, folded, unknown, or none; line ends without their CR */
		{"multipart/mixed; boundary=ab",
		 "--ab\r\nCONTENT-LENGTH:\r\n 2\r\nX: --ab\r\n\r\n<a\r\n--ab\r\n\r\n<b\r\n--ab--"},
		{"multipart/mixed; boundary=ab", "--ab\n\n<a\n--ab\n\n<b\n--ab--\n"},
	};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		for (size_t piece = 1; piece <= strlen(cases[i].stream); piece++) {
			const char *parts = split_as(cases[i].type, cases[i].stream, piece);

			if (strcmp(parts, "<a|<b|") != 0)
				fail_msg("case %zu in pieces of %zu: '%s'", i, piece, parts);
		}
	}
}

/* What is like a short boundary is no end of a picture that goes on. */
static void test_a_short_boundary_is_not_found_in_pictures(void **state)
{
	static const char stream[] = "--b\r\n\r\n<b -b --b \nb b" END "\r\n--b\r\n\r\n<b" END;

	(void)state;
	for (size_t piece = 1; piece < sizeof(stream); piece++)
		assert_string_equal(split_as("multipart/mixed; boundary=b", stream, piece),
				    "<b -b --b \nb b()|<b()|");
}

static void test_parts_without_room_are_left_out(void **state)
{
	(void)state;
	sink.no_room = true;
	assert_string_equal(split(LINE "\r\n<ab" END "\r\n" LINE "\r\n<c" END, 7), "");
	sink.no_room = false;
	assert_string_equal(split(LINE "\r\n<ab" END, 7), "<ab()|");
}

static void test_types_that_are_none(void **state)
{
	static const char *const bad[] = {
		"image/jpeg", "multipart/mixed",
		"multipart/mixed; boundary=", "multipart/mixed; boundary=\"\"",
		"multipart/mixed; boundary=0123456789012345678901234567890123456789012345678901234"
		"5678901234567890"};
	const struct lp_multipart_sink where = {NULL, reserve, is_whole, on_part};
	struct lp_multipart multipart;

	(void)state;
	assert_int_equal(lp_multipart_init(&multipart, NULL, &where), -EPROTO);
	for (size_t i = 0; i < LP_COUNT(bad); i++)
		assert_int_equal(lp_multipart_init(&multipart, bad[i], &where), -EPROTO);
	assert_int_equal(lp_multipart_init(&multipart, "Multipart/Mixed; Boundary=ab; x=y", &where),
			 0);
	assert_string_equal(multipart.boundary, "ab");
}

/* ---------------------------------------------------------------- answers */

static int check(int status, const char *text, struct lp_osc_fault *fault)
{
	const struct lp_osc_reply reply = {status, text, strlen(text)};

	return lp_osc_reply_check(&reply, "camera.test", false, NULL, fault);
}

static void test_answers(void **state)
{
	struct lp_osc_fault fault;

	(void)state;
	assert_int_equal(check(200, "{\"state\":\"done\"}", &fault), 0);
	assert_int_equal(check(503, "{\"error\":{\"code\":\"serviceUnavailable\"}}", &fault),
			 -EAGAIN);
	assert_int_equal(fault.state, LP_SOURCE_STALLED);
	assert_int_equal(check(403, "{\"error\":{\"code\":\"disabledCommand\",\"message\":\"m\"}}",
			       &fault),
			 -EPERM);
	assert_int_equal(fault.state, LP_SOURCE_WAITING);
	assert_non_null(strstr(fault.reason, "leave playback"));
	assert_int_equal(check(400, "{\"error\":{\"code\":\"new\",\"message\":7}}", &fault), -EIO);
	assert_int_equal(check(401, "", &fault), -EACCES);
	assert_non_null(strstr(fault.reason, "password_file=FILE"));
	assert_int_equal(check(404, "<html>", &fault), -EPROTO);
	assert_int_equal(check(200, "[1]", &fault), -EPROTO);
	assert_int_equal(check(200, "", &fault), -EPROTO);
	assert_int_equal(check(500, "{}", &fault), -EPROTO);
}

static void test_health(void **state)
{
	static const char text[] = "{\"state\":{\"batteryLevel\":0.25,\"_batteryState\":"
				   "\"charging\",\"_boardTemp\":61,\"_cameraError\":[\"A\"]}}";
	static const char *const impossible[] = {
		"{\"state\":{\"batteryLevel\":-1e300,\"_boardTemp\":1e300}}",
		"{\"state\":{\"batteryLevel\":-0.01,\"_boardTemp\":-1e39}}",
		"{\"state\":{\"batteryLevel\":25,\"_boardTemp\":1000}}",
		"{\"state\":{\"batteryLevel\":\"1\",\"_boardTemp\":null}}",
	};
	struct lp_osc_reply reply = {200, text, sizeof(text) - 1};
	struct lp_osc_health health;

	(void)state;
	assert_true(lp_osc_health_read(&reply, &health));
	assert_float_equal(health.battery, 0.25, 1e-6);
	assert_float_equal(health.temperature_c, 61, 1e-6);
	assert_true(health.is_charging);
	assert_string_equal(health.error, "A");
	reply = (struct lp_osc_reply){200, "{\"state\":{\"_cameraError\":7}}", 28};
	assert_true(lp_osc_health_read(&reply, &health));
	assert_true(isnan(health.battery) && isnan(health.temperature_c) && !*health.error);
	for (size_t k = 0; k < LP_COUNT(impossible); k++) {
		reply = (struct lp_osc_reply){200, impossible[k], strlen(impossible[k])};
		assert_true(lp_osc_health_read(&reply, &health));
		assert_true(isnan(health.battery) && isnan(health.temperature_c));
	}
	reply = (struct lp_osc_reply){200, "nonsense", 8};
	assert_false(lp_osc_health_read(&reply, &health));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_addresses),
		cmocka_unit_test(test_passwords),
		cmocka_unit_test(test_parts_however_they_are_cut),
		cmocka_unit_test(test_every_legal_framing),
		cmocka_unit_test(test_a_short_boundary_is_not_found_in_pictures),
		cmocka_unit_test(test_parts_without_room_are_left_out),
		cmocka_unit_test(test_types_that_are_none),
		cmocka_unit_test(test_answers),
		cmocka_unit_test(test_health),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
