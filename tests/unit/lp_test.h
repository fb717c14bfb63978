/* SPDX-License-Identifier: Apache-2.0 */
/* What every unit test needs: cmocka with the headers it wants before it, and captured log lines.
 */
#ifndef LP_TEST_H
#define LP_TEST_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/macros.h"

/* Standard error goes to memory between begin and end. */
struct capture {
	int saved_fd, memory_fd;
	char text[8192];
};

static inline void capture_begin(struct capture *capture)
{
	capture->saved_fd = dup(STDERR_FILENO);
	capture->memory_fd = memfd_create("stderr", MFD_CLOEXEC);
	assert_true(capture->saved_fd >= 0 && capture->memory_fd >= 0);
	assert_true(dup2(capture->memory_fd, STDERR_FILENO) >= 0);
}

static inline const char *capture_end(struct capture *capture)
{
	ssize_t length;

	assert_true(dup2(capture->saved_fd, STDERR_FILENO) >= 0);
	length = pread(capture->memory_fd, capture->text, sizeof(capture->text) - 1, 0);
	assert_true(length >= 0);
	capture->text[length] = '\0';
	close(capture->saved_fd);
	close(capture->memory_fd);
	return capture->text;
}

static inline void assert_contains(const char *text, const char *part)
{
	if (!strstr(text, part))
		fail_msg("'%s' is not in '%s'", part, text);
}

#endif
