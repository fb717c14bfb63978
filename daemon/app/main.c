/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <unistd.h>

#include "app/backends.h"
#include "app/daemon.h"
#include "app/options/options.h"
#include "app/series/series.h"
#include "base/log.h"

#define LEAST_DESCRIPTORS 32

static void print_help(void)
{
	(void)printf("lightprobed " LP_VERSION ": measures real light and publishes it\n\n"
		     "lightprobed --source=URI [--publish=URI]... [OPTION=VALUE]...\n\n");
	lp_options_help(stdout);
	lp_backends_list(stdout);
	(void)printf("\nURIs have the form SCHEME:REST?KEY=VALUE&KEY=VALUE; lightprobed "
		     "--help-backends lists the keys.\n"
		     "\nExit status: 0 it ended as requested; 1 a device or a socket failed, or no "
		     "estimate was made;\n"
		     "2 the command line or the configuration is wrong.\n");
}

static void print_version(void)
{
	(void)printf("lightprobed " LP_VERSION "\nvariant=" LP_VARIANT "\n");
	lp_backends_version(stdout);
}

/* Many clients need many descriptors; the hard limit is the administrator's. */
static void raise_descriptor_limit(void)
{
	struct rlimit limit;

	if (getrlimit(RLIMIT_NOFILE, &limit) == 0) {
		limit.rlim_cur = limit.rlim_max;
		(void)setrlimit(RLIMIT_NOFILE, &limit);
	}
}

/*
 * Find out first whether there are file descriptors enough: what opens them later (libuv,
 * libcamera, ourselves) would abort, or fail in silence. A few clients are among the number.
 */
static bool has_descriptors(void)
{
	int fds[LEAST_DESCRIPTORS], count = 0, ret;

	while (count < LEAST_DESCRIPTORS && (fds[count] = eventfd(0, EFD_CLOEXEC)) >= 0)
		count++;
	ret = errno;
	if (count < LEAST_DESCRIPTORS)
		lp_error("lightprobed", "start",
			 "%s: only %d more files can be opened, and %d are needed — raise ulimit "
			 "-n, or LimitNOFILE= of the service",
			 lp_strerror(ret), count, LEAST_DESCRIPTORS);
	for (int i = 0; i < count; i++)
		close(fds[i]);
	return count == LEAST_DESCRIPTORS;
}

static void say_good(const struct lp_options *options)
{
	(void)printf("configuration is good: source");
	for (int k = 0; k < options->source.count; k++)
		(void)printf(" %s", options->source.texts[k]);
	(void)printf("%s, %d publishers\n", options->source.count ? "" : " none: the ring alone",
		     options->publish.count);
}

static int run(const struct lp_options *options)
{
	if (options->help) {
		print_help();
		return LP_EXIT_OK;
	}
	if (options->help_once) {
		lp_options_help_once(stdout);
		return LP_EXIT_OK;
	}
	if (options->help_backends) {
		lp_backends_help(stdout);
		return LP_EXIT_OK;
	}
	if (options->version) {
		print_version();
		return LP_EXIT_OK;
	}
	if (!has_descriptors())
		return LP_EXIT_FAILURE;
	if (options->check_config) {
		const int exit_code = lp_daemon_check(options);

		if (exit_code == LP_EXIT_OK)
			say_good(options);
		return exit_code;
	}
	return *options->series ? lp_series_run(options) : lp_daemon_run(options);
}

int main(int argc, char **argv)
{
	struct lp_options *options = malloc(sizeof(*options));
	int exit_code = LP_EXIT_USAGE;

	if (!options)
		return LP_EXIT_FAILURE;
	(void)signal(SIGPIPE, SIG_IGN); /* writers see EPIPE instead */
	raise_descriptor_limit();
	if (lp_options_read(options, argc, argv) == 0) {
		lp_log_set_level((enum lp_log_level)options->log_level);
		exit_code = run(options);
	}
	free(options);
	return exit_code;
}
