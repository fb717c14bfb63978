/* SPDX-License-Identifier: Apache-2.0 */
/* A camera file of a test's own. */
#ifndef LP_CAMERA_FILE_TEST_H
#define LP_CAMERA_FILE_TEST_H

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "vision/camera/camera_file.h"

/* Write `text` into a file and read that; results as of lp_camera_file_read(). */
static inline int read_camera_file(const char *text, struct lp_camera_file **file)
{
	char path[] = "/tmp/lp-camera-XXXXXX";
	const int fd = mkstemp(path);
	int ret;

	assert_true(fd >= 0);
	assert_int_equal(write(fd, text, strlen(text)), (ssize_t)strlen(text));
	close(fd);
	ret = lp_camera_file_read(path, file);
	unlink(path);
	return ret;
}

#endif
