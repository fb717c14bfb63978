/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <stdio.h>
#include <stdlib.h>

#include "app/backends.h"
#include "base/loop.h"
#include "base/param.h"
#include "base/uri.h"
#include "include/backend.h"
#include "include/connections.h"
#include "include/orientation.h"
#include "include/publisher.h"
#include "include/ring.h"
#include "include/rotator.h"
#include "include/source.h"

static const struct lp_backend *some_at(int i)
{
	static const struct lp_backend infos[] = {{.scheme = "file"},
						  {.scheme = "v4l2", .left_out = "WITH_V4L2"}};

	return &infos[i];
}

static int find(const char *text)
{
	static const struct lp_backend_role role = {"source", "Sources", 2, some_at};
	struct lp_uri uri;

	assert_int_equal(lp_uri_parse(&uri, text), 0);
	return lp_backend_find(&role, &uri);
}

static void test_found_by_scheme(void **state)
{
	(void)state;
	assert_int_equal(find("file:a"), 0);
}

static void test_unknown_and_not_built_are_different_messages(void **state)
{
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	assert_int_equal(find("ftp:a"), -EPROTONOSUPPORT);
	assert_int_equal(find("v4l2:/dev/video0"), -EPROTONOSUPPORT);
	capture_end(&capture);
	assert_contains(
		capture.text,
		"error ftp:a: source: ftp: is not a known scheme; known are file:, v4l2:\n");
	assert_contains(capture.text,
			"error v4l2:/dev/video0: source: v4l2: is known, but not part of "
			"this build — build it with make daemon WITH_V4L2=1\n");
}

static struct lp_loop *loop;

static int setup(void **state)
{
	(void)state;
	return lp_loop_create(&loop);
}

static int teardown(void **state)
{
	(void)state;
	lp_loop_destroy(loop);
	return 0;
}

/* ---------------------------------------------------------------- every back end */

static struct lp_connections connections;

/* Create what the URI names and destroy it again. 0 or the error of create(). */
static int try_source(const char *uri)
{
	const struct lp_source_host host = {.loop = loop};
	struct lp_source *source;
	const int ret = lp_source_open(uri, &host, &source);

	if (ret == 0) {
		assert_true(source->ops->start && source->ops->caps);
		const struct lp_source_ops *ops = source->ops;

		ops->destroy(source);
		ops->destroy(NULL);
	}
	return ret;
}

static int try_rotator(const char *uri)
{
	const struct lp_rotator_host host = {.loop = loop, .connections = &connections};
	struct lp_rotator *rotator;
	const int ret = lp_rotator_open(uri, &host, &rotator);

	if (ret == 0) {
		assert_true(rotator->ops->start && rotator->ops->move && rotator->ops->look);
		const struct lp_rotator_ops *ops = rotator->ops;

		ops->destroy(rotator);
		ops->destroy(NULL);
	}
	return ret;
}

static int try_ring(const char *uri)
{
	const struct lp_ring_host host = {.loop = loop, .connections = &connections};
	struct lp_ring *ring;
	const int ret = lp_ring_open(uri, &host, &ring);

	if (ret == 0) {
		assert_non_null(ring->ops->start);
		const struct lp_ring_ops *ops = ring->ops;

		ops->destroy(ring);
		ops->destroy(NULL);
	}
	return ret;
}

static int try_orientation(const char *uri)
{
	const struct lp_orientation_host host = {.loop = loop};
	struct lp_orientation *sensor;
	const int ret = lp_orientation_open(uri, &host, &sensor);

	if (ret == 0) {
		assert_non_null(sensor->ops->start);
		const struct lp_orientation_ops *ops = sensor->ops;

		ops->destroy(sensor);
		ops->destroy(NULL);
	}
	return ret;
}

static int try_publisher(const char *uri)
{
	const struct lp_publisher_host host = {.loop = loop, .max_clients = 8};
	struct lp_publisher *publisher;
	const int ret = lp_publisher_open(uri, &host, &publisher);

	if (ret == 0) {
		assert_true(publisher->ops->start && publisher->ops->send &&
			    publisher->ops->pending);
		const struct lp_publisher_ops *ops = publisher->ops;

		ops->destroy(publisher);
		ops->destroy(NULL);
	}
	return ret;
}

/* In the order of lp_backend_roles. */
static int (*const try[])(const char *uri) = {try_source, try_rotator, try_ring, try_orientation,
					      try_publisher};

/* ---------------------------------------------------------------- a pair for wss: */

static char pair_folder[] = "/tmp/lp-backends-XXXXXX";

static FILE *create_file(const char *name)
{
	char path[64];
	FILE *file;

	(void)snprintf(path, sizeof(path), "%s/%s", pair_folder, name);
	file = fopen(path, "w");
	assert_non_null(file);
	return file;
}

/* As `lightprobe pair` makes it, as far as the daemon looks. */
static int make_pair(void **state)
{
	EVP_PKEY *key = EVP_EC_gen("P-256");
	X509 *certificate = X509_new();
	FILE *file;

	(void)state;
	assert_non_null(mkdtemp(pair_folder));
	X509_gmtime_adj(X509_getm_notBefore(certificate), -60);
	X509_gmtime_adj(X509_getm_notAfter(certificate), 3600);
	X509_set_pubkey(certificate, key);
	assert_true(X509_sign(certificate, key, EVP_sha256()) > 0);
	file = create_file("certificate.pem");
	PEM_write_X509(file, certificate);
	fclose(file);
	file = create_file("key.pem");
	PEM_write_PrivateKey(file, key, NULL, NULL, 0, NULL, NULL);
	fclose(file);
	file = create_file("token");
	fputs("0123456789abcdef\n", file);
	fclose(file);
	X509_free(certificate);
	EVP_PKEY_free(key);
	return 0;
}

static int remove_pair(void **state)
{
	const char *const names[] = {"certificate.pem", "key.pem", "token", ""};
	char path[64];

	(void)state;
	for (size_t i = 0; i < LP_COUNT(names); i++) {
		(void)snprintf(path, sizeof(path), "%s/%s", pair_folder, names[i]);
		(void)remove(path);
	}
	return 0;
}

/* What must stand in the query of a URI of this scheme. */
static const char *needs_of(const char *scheme)
{
	static char needs[64];

	(void)snprintf(needs, sizeof(needs), "?pair=%s", pair_folder);
	return strcmp(scheme, "wss") == 0 ? needs : "";
}

static const char *joint_of(const char *uri)
{
	return strchr(uri, '?') ? "&" : "?";
}

/* What stands for each form, in a URI that create() takes. */
static const char *example_of(const char *form)
{
	static const struct {
		const char *form, *example;
	} examples[] = {
		{"", ""},
		{"DEVICE", "/nowhere"},
		{"CAMERA", "nothing"},
		{"PATH", "/nowhere"},
		{"CARRIER:DEVICE", "serial:/nowhere"},
		{"I2C-DEVICE", "/nowhere"},
		{"HOST:PORT", "127.0.0.1:0"},
		{"[NAME]", "gyro_3d"},
		{"HOST[:PORT]", "192.0.2.1:8080"},
		{"[SERIAL]", "00000042"},
		{"HOST[:PORT]/TOPIC", "127.0.0.1/a"},
	};

	for (size_t i = 0; i < LP_COUNT(examples); i++) {
		if (strcmp(examples[i].form, form) == 0)
			return examples[i].example;
	}
	fail_msg("form '%s': give an example of it", form);
	return "";
}

static const char *default_of(const struct lp_param *param)
{
	if (param->initial && *param->initial)
		return param->initial;
	switch (param->type) {
	case LP_PARAM_SIZE:
		return "64x32";
	case LP_PARAM_FLOATS:
		return "1,2";
	case LP_PARAM_TEXT: /* a file that is not there is an error of its own */
		return NULL;
	default:
		return "1";
	}
}

/* Each key that the help names is one that create() reads, and has words of its own. */
static void check_keys(int k, const struct lp_backend *info, const char *uri)
{
	for (const struct lp_params *params = info->params; params; params = params->more) {
		for (size_t i = 0; i < params->count; i++) {
			const struct lp_param *param = &params->list[i];
			const char *value = default_of(param);
			char text[256];

			assert_true(param->help && *param->help);
			if (strcmp(param->name, "pair") == 0)
				continue; /* it is in the URI already */
			(void)snprintf(text, sizeof(text), "%s%s%s=%s", uri, joint_of(uri),
				       param->name, value ? value : "");
			if (try[k](text) != 0)
				fail_msg("%s is in the help, and an error", text);
		}
	}
}

/* Every key that create() knows is one that the help names. */
static void check_unknown_key(int k, const struct lp_backend *info, const char *uri)
{
	char text[600], known[512] = "";
	struct capture capture;
	size_t used = 0;

	for (const struct lp_params *params = info->params; params; params = params->more) {
		for (size_t i = 0; i < params->count; i++)
			used += (size_t)snprintf(known + used, sizeof(known) - used, "%s%s",
						 used ? ", " : "", params->list[i].name);
	}
	/* Of each role its own: the log counts what it has said before. */
	(void)snprintf(text, sizeof(text), "%s%sno_such_key=%d", uri, joint_of(uri), k);
	capture_begin(&capture);
	assert_int_equal(try[k](text), -EINVAL);
	capture_end(&capture);
	(void)snprintf(text, sizeof(text), "no_such_key: unknown key; known: %s\n",
		       used ? known : "(none)");
	assert_contains(capture.text, text);
}

static void test_the_help_is_what_create_reads(void **state)
{
	const struct lp_backend *info;
	int count = 0;

	(void)state;
	for (int k = 0; lp_backend_roles[k]; k++) {
		for (int i = 0; i < lp_backend_roles[k]->count; i++, count++) {
			info = lp_backend_roles[k]->at(i);
			char uri[128];

			assert_null(info->left_out); /* tests are built with everything */
			(void)snprintf(uri, sizeof(uri), "%s:%s%s", info->scheme,
				       example_of(info->form), needs_of(info->scheme));
			assert_int_equal(try[k](uri), 0);
			check_keys(k, info, uri);
			/* The simulator's query is passed on to it. */
			if (!(try[k] == try_source && strcmp(info->scheme, "sim") == 0))
				check_unknown_key(k, info, uri);
		}
	}
	assert_int_equal(count, 21);
	assert_null(connections.first);
}

static void test_help_names_every_key_with_its_default(void **state)
{
	const struct lp_backend *info;
	char *text = NULL, *list = NULL;
	size_t size;
	FILE *out = open_memstream(&text, &size), *listed = open_memstream(&list, &size);

	(void)state;
	lp_backends_help(out);
	lp_backends_list(listed);
	fclose(out);
	fclose(listed);
	for (int k = 0; lp_backend_roles[k]; k++) {
		for (int i = 0; i < lp_backend_roles[k]->count; i++) {
			info = lp_backend_roles[k]->at(i);
			char uri[64];

			(void)snprintf(uri, sizeof(uri), "  %s:%s", info->scheme, info->form);
			assert_contains(text, uri);
			assert_contains(list, uri);
		}
	}
	assert_contains(
		text,
		"\n      stall_ms=1000   (a number 100..60000)\n          time without a frame");
	assert_contains(text, "\n      slew_deg_s=90   (a number 10..400)\n");
	free(text);
	free(list);
}

static void test_wrong_keys_are_errors_of_create(void **state)
{
	static const char *const bad_sources[] = {"file:", "file:a?speed=1",  "file:a?rate=-1",
						  "sim:",  "file:a?size=640", "example:?rate=0"};
	static const char *const bad_publishers[] = {"tcp:127.0.0.1:1?mode=1",
						     "unix:/a?mode=9",
						     "unix:/a?mode=1777",
						     "stdout:x",
						     "stdout:?a=b",
						     "mqtt:a?qos=1"};
	const struct lp_source_host source_host = {.loop = loop};
	const struct lp_publisher_host publisher_host = {.loop = loop};
	struct lp_source *source;
	struct lp_publisher *publisher;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad_sources); i++)
		assert_int_equal(lp_source_open(bad_sources[i], &source_host, &source), -EINVAL);
	for (size_t i = 0; i < LP_COUNT(bad_publishers); i++)
		assert_int_equal(lp_publisher_open(bad_publishers[i], &publisher_host, &publisher),
				 -EINVAL);
	assert_int_equal(lp_source_open("tcp:127.0.0.1:1", &source_host, &source),
			 -EPROTONOSUPPORT);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_found_by_scheme),
		cmocka_unit_test(test_unknown_and_not_built_are_different_messages),
		cmocka_unit_test_setup_teardown(test_the_help_is_what_create_reads, make_pair,
						remove_pair),
		cmocka_unit_test(test_help_names_every_key_with_its_default),
		cmocka_unit_test(test_wrong_keys_are_errors_of_create),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
