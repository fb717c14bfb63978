/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/file/pose_file.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "include/orientation.h"

#define NUMBERS 8
/* Between poses further apart nobody knows how the camera was turned. */
#define LONGEST_GAP_S 0.25
/* Rounding of times, and of the rate of the pictures. */
#define ROUNDING_S 1e-6
#define TUM "t x y z qx qy qz qw"
#define EUROC "t, x, y, z, qw, qx, qy, qz"

struct pose {
	double t_s, position_m[3], xyzw[4];
};

struct lp_pose_file {
	struct pose *poses;
	size_t count, room;
	bool is_euroc;
	double start; /* time of the first pose, as it stands; a double holds Unix time to 0.3 us */
};

/* The next number of a line, and what stands between it and the one after; separator 0: space. */
static bool read_number(const char **at, char separator, double *value)
{
	char *end;

	*value = strtod(*at, &end);
	if (end == *at || !isfinite(*value))
		return false;
	const size_t space = strspn(end, " \t\r\n");

	*at = end + space;
	if (separator && **at == separator)
		(*at)++;
	else if (**at && (separator || !space))
		return false;
	return true;
}

static bool read_pose(struct lp_pose_file *file, const char *line, struct pose *pose)
{
	const char separator = file->is_euroc ? ',' : 0;
	double values[NUMBERS], length2 = 0.0;
	const char *at = line;

	for (int i = 0; i < NUMBERS; i++)
		if (!read_number(&at, separator, &values[i]))
			return false;
	if (*at && !file->is_euroc)
		return false;
	if (file->count == 0)
		file->start = values[0];
	pose->t_s = (values[0] - file->start) * (file->is_euroc ? 1e-9 : 1.0);
	memcpy(pose->position_m, &values[1], sizeof(pose->position_m));
	for (int i = 0; i < 4; i++) /* EuRoC has w first */
		pose->xyzw[i] = values[4 + (file->is_euroc ? (i + 1) % 4 : i)];
	for (int i = 0; i < 4; i++)
		length2 += pose->xyzw[i] * pose->xyzw[i];
	if (!(fabs(length2 - 1.0) < LP_MOST_NOT_UNIT))
		return false;
	for (int i = 0; i < 4; i++)
		pose->xyzw[i] /= sqrt(length2);
	return file->count == 0 || pose->t_s > file->poses[file->count - 1].t_s;
}

static int add(struct lp_pose_file *file, const struct pose *pose)
{
	if (file->count == file->room) {
		const size_t room = 2 * file->room + 256;
		struct pose *poses = realloc(file->poses, room * sizeof(*poses));

		if (!poses)
			return -ENOMEM;
		file->poses = poses;
		file->room = room;
	}
	file->poses[file->count++] = *pose;
	return 0;
}

static int read_lines(struct lp_pose_file *file, FILE *stream, const char *path)
{
	char *line = NULL;
	size_t size = 0;
	int number = 0, ret = 0;

	errno = 0;
	while (ret == 0 && getline(&line, &size, stream) >= 0) {
		const char *text = line + strspn(line, " \t\r\n");
		struct pose pose;

		number++;
		if (!*text || *text == '#')
			continue;
		if (file->count == 0)
			file->is_euroc = strchr(text, ',');
		if (read_pose(file, text, &pose)) {
			ret = add(file, &pose);
		} else {
			lp_error(path, "poses",
				 "line %d: expected %s, a unit quaternion, and times that rise",
				 number, file->is_euroc ? EUROC : TUM);
			ret = -EBADMSG;
		}
	}
	if (ret == 0 && (ferror(stream) || errno == ENOMEM))
		ret = errno ? -errno : -EIO;
	free(line);
	return ret;
}

/* A regular file, open to read; a pipe might never end, nor begin. */
static int open_stream(const char *path, FILE **stream)
{
	struct stat status;
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	int ret = fd < 0 || fstat(fd, &status) < 0 ? -errno : 0;

	if (ret == 0 && !S_ISREG(status.st_mode))
		ret = S_ISDIR(status.st_mode) ? -EISDIR : -ESPIPE;
	if (ret == 0) {
		*stream = fdopen(fd, "r");
		ret = *stream ? 0 : -errno;
	}
	if (ret < 0 && fd >= 0)
		close(fd);
	return ret;
}

int lp_pose_file_read(const char *path, struct lp_pose_file **file)
{
	struct lp_pose_file *self = calloc(1, sizeof(*self));
	FILE *stream = NULL;
	int ret = self ? open_stream(path, &stream) : -ENOMEM;

	if (ret == 0)
		ret = read_lines(self, stream, path);
	if (stream)
		(void)fclose(stream);
	if (ret == 0 && self->count == 0) {
		lp_error(path, "poses", "no pose in it: expected lines of %s, or of %s", TUM,
			 EUROC);
		ret = -EBADMSG;
	} else if (ret < 0 && ret != -EBADMSG) {
		lp_error(path, "poses", "%s — check the path", lp_strerror(ret));
	}
	if (ret < 0) {
		lp_pose_file_destroy(self);
		return ret;
	}
	*file = self;
	return 0;
}

/* The last pose that is not later. */
static size_t before(const struct lp_pose_file *file, double t_s)
{
	size_t low = 0, high = file->count;

	while (high - low > 1) {
		const size_t middle = low + (high - low) / 2;

		if (file->poses[middle].t_s <= t_s)
			low = middle;
		else
			high = middle;
	}
	return low;
}

bool lp_pose_file_at(const struct lp_pose_file *file, double t_s, float quaternion[4],
		     double position_m[3])
{
	const size_t i = before(file, t_s);
	const struct pose *a = &file->poses[i];
	const struct pose *b = i + 1 < file->count ? a + 1 : a;
	double share = b == a ? 0.0 : (t_s - a->t_s) / (b->t_s - a->t_s), dot = 0.0, length2 = 0.0;
	double between[4];

	if (t_s < a->t_s - ROUNDING_S || t_s > b->t_s + ROUNDING_S)
		return false;
	if (b->t_s - a->t_s > LONGEST_GAP_S && t_s > a->t_s + ROUNDING_S)
		return false;
	share = fmin(fmax(share, 0.0), 1.0);
	for (int k = 0; k < 4; k++)
		dot += a->xyzw[k] * b->xyzw[k];
	for (int k = 0; k < 4; k++) { /* they are near each other: a chord is as good as the arc */
		between[k] = (1.0 - share) * a->xyzw[k] + (dot < 0.0 ? -share : share) * b->xyzw[k];
		length2 += between[k] * between[k];
	}
	for (int k = 0; k < 4; k++)
		quaternion[k] = (float)(between[k] / sqrt(length2));
	for (int k = 0; k < 3; k++)
		position_m[k] = (1.0 - share) * a->position_m[k] + share * b->position_m[k];
	return true;
}

void lp_pose_file_destroy(struct lp_pose_file *file)
{
	if (!file)
		return;
	free(file->poses);
	free(file);
}
