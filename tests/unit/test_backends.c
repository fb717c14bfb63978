/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>

#include "app/backends.h"
#include "base/loop.h"
#include "base/uri.h"
#include "include/publisher.h"
#include "include/source.h"

static const int some_ops;

static const struct lp_backend table[] = {
	{"file", NULL, &some_ops},
	{"v4l2", "WITH_V4L2", NULL},
	{0},
};

static const void *find(const char *text)
{
	struct lp_uri uri;

	assert_int_equal(lp_uri_parse(&uri, text), 0);
	return lp_backend_find(table, "source", &uri);
}

static void test_found_by_scheme(void **state)
{
	(void)state;
	assert_ptr_equal(find("file:a"), &some_ops);
}

static void test_unknown_and_not_built_are_different_messages(void **state)
{
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	assert_null(find("ftp:a"));
	assert_null(find("v4l2:/dev/video0"));
	capture_end(&capture);
	assert_contains(capture.text,
			"error ftp:a: source: ftp: is no known scheme; known: file:, v4l2:\n");
	assert_contains(capture.text, "error v4l2:/dev/video0: source: v4l2: is known but not in "
				      "this build — make daemon WITH_V4L2=1\n");
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

static void test_every_back_end_states_its_contract(void **state)
{
	static const char *const sources[] = {
		"file:/nowhere",
		"sim:/nowhere",
		"v4l2:/nowhere",
		"example:",
#if WITH_LIBCAMERA
		"libcamera:nothing",
#endif
	};
	static const char *const publishers[] = {"tcp:127.0.0.1:0", "unix:/nowhere", "stdout:"};
	const struct lp_source_host source_host = {.loop = loop};
	const struct lp_publisher_host publisher_host = {.loop = loop};

	(void)state;
	for (size_t i = 0; i < ARRAY_COUNT(sources); i++) {
		struct lp_source *source;

		assert_int_equal(lp_source_open(sources[i], &source_host, &source), 0);
		assert_memory_equal(source->ops->scheme, sources[i], strlen(source->ops->scheme));
		assert_memory_equal(source->ops->help, sources[i], strlen(source->ops->scheme));
		assert_true(source->ops->start && source->ops->caps);
		const struct lp_source_ops *ops = source->ops;

		ops->destroy(source);
		ops->destroy(NULL);
	}
	for (size_t i = 0; i < ARRAY_COUNT(publishers); i++) {
		struct lp_publisher *publisher;

		assert_int_equal(lp_publisher_open(publishers[i], &publisher_host, &publisher), 0);
		assert_memory_equal(publisher->ops->help, publishers[i],
				    strlen(publisher->ops->scheme));
		assert_true(publisher->ops->start && publisher->ops->send &&
			    publisher->ops->pending);
		const struct lp_publisher_ops *ops = publisher->ops;

		ops->destroy(publisher);
		ops->destroy(NULL);
	}
}

static void test_wrong_keys_are_errors_of_create(void **state)
{
	static const char *const bad_sources[] = {"file:", "file:a?speed=1",  "file:a?rate=-1",
						  "sim:",  "file:a?size=640", "example:?rate=0"};
	static const char *const bad_publishers[] = {"tcp:127.0.0.1:1?mode=1", "unix:/a?mode=9",
						     "unix:/a?mode=1777", "stdout:x",
						     "stdout:?a=b"};
	const struct lp_source_host source_host = {.loop = loop};
	const struct lp_publisher_host publisher_host = {.loop = loop};
	struct lp_source *source;
	struct lp_publisher *publisher;

	(void)state;
	for (size_t i = 0; i < ARRAY_COUNT(bad_sources); i++)
		assert_int_equal(lp_source_open(bad_sources[i], &source_host, &source), -EINVAL);
	for (size_t i = 0; i < ARRAY_COUNT(bad_publishers); i++)
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
		cmocka_unit_test(test_every_back_end_states_its_contract),
		cmocka_unit_test(test_wrong_keys_are_errors_of_create),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
