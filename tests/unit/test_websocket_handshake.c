/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include "drivers/publisher/websocket/handshake.h"

static void test_programs_send_no_origin(void **state)
{
	(void)state;
	assert_true(lp_origin_is_ok("", "127.0.0.1:7701", ""));
}

static void test_the_own_page_may_connect(void **state)
{
	(void)state;
	assert_true(lp_origin_is_ok("http://127.0.0.1:7701", "127.0.0.1:7701", ""));
	assert_true(lp_origin_is_ok("https://Probe.local:7702", "probe.LOCAL:7702", ""));
	assert_true(lp_origin_is_ok("http://[::1]:7701", "[::1]:7701", ""));
}

static void test_other_pages_may_not(void **state)
{
	const char *const origins[] = {"http://evil.example",
				       "http://127.0.0.1:7702",
				       "http://127.0.0.1",
				       "null",
				       "file://",
				       "http://",
				       "http://127.0.0.1:7701.evil.example",
				       "http://evil.example/127.0.0.1:7701",
				       "127.0.0.1:7701"};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(origins); i++)
		assert_false(lp_origin_is_ok(origins[i], "127.0.0.1:7701", ""));
	assert_false(lp_origin_is_ok("http://", "", "")); /* no Host is no reason either */
}

static void test_origins_can_be_allowed(void **state)
{
	const char *list = "https://app.example, http://localhost:5173";

	(void)state;
	assert_true(lp_origin_is_ok("https://app.example", "127.0.0.1:7701", list));
	assert_true(lp_origin_is_ok("http://localhost:5173", "127.0.0.1:7701", list));
	assert_false(lp_origin_is_ok("https://app.exampl", "127.0.0.1:7701", list));
	assert_false(lp_origin_is_ok("https://app.example.evil", "127.0.0.1:7701", list));
	assert_false(lp_origin_is_ok("http://localhost", "127.0.0.1:7701", list));
}

static void test_hosts_that_mean_this_machine(void **state)
{
	const char *const good[] = {"127.0.0.1:7701",  "127.0.0.1",	   "[::1]:7701",
				    "192.168.1.20:80", "localhost:1",	   "LOCALHOST",
				    "probe:7701",      "probe.local:7701", "app.example"};
	const char *const bad[] = {"",
				   "evil.example:7701",
				   "127.0.0.1.evil.example",
				   "127.0.0.1:7701, evil.example",
				   "localhost:evil",
				   "[::1].evil",
				   "[::1",
				   "probe.local.evil",
				   ":7701"};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(good); i++)
		assert_true(lp_host_is_ok(good[i], "probe", "https://app.example"));
	for (size_t i = 0; i < LP_COUNT(bad); i++)
		assert_false(lp_host_is_ok(bad[i], "probe", "https://app.example"));
	assert_false(lp_host_is_ok(".local", "", ""));
}

static void test_a_token_is_one_of_the_protocols(void **state)
{
	const char *token = "0123456789abcdef";

	(void)state;
	assert_true(lp_token_is_offered("lightprobe.v1, token.0123456789abcdef", token));
	assert_true(lp_token_is_offered("token.0123456789abcdef,lightprobe.v1", token));
	assert_false(lp_token_is_offered("lightprobe.v1", token));
	assert_false(lp_token_is_offered("", token));
	assert_false(lp_token_is_offered("token.", token));
	assert_false(lp_token_is_offered("token.0123456789abcdeF", token));
	assert_false(lp_token_is_offered("token.0123456789abcde", token));
	assert_false(lp_token_is_offered("token.0123456789abcdef0", token));
	assert_false(lp_token_is_offered("0123456789abcdef", token));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_programs_send_no_origin),
		cmocka_unit_test(test_the_own_page_may_connect),
		cmocka_unit_test(test_other_pages_may_not),
		cmocka_unit_test(test_origins_can_be_allowed),
		cmocka_unit_test(test_hosts_that_mean_this_machine),
		cmocka_unit_test(test_a_token_is_one_of_the_protocols),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
