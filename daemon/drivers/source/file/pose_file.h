/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Recorded poses of a camera, in the two forms that data sets of visual-inertial odometry use.
 * TUM: "t x y z qx qy qz qw", seconds. EuRoC: "t, x, y, z, qw, qx, qy, qz, ...", nanoseconds; what
 * follows is left. Lines that begin with # are comments. The first line tells which form it is.
 * host_py/lightprobe/sim/track_file.py reads the same for the simulator.
 */
#ifndef LP_SOURCE_FILE_POSE_FILE_H
#define LP_SOURCE_FILE_POSE_FILE_H

#include <stdbool.h>

struct lp_pose_file;

/* Reads all of it. -ENOENT, -EACCES, ..., -EBADMSG: a line is no pose; logged with its number. */
int lp_pose_file_read(const char *path, struct lp_pose_file **file);

/*
 * The pose at a time after the first one, between its neighbours: quaternion x y z w, turns the
 * camera's frame into that of the poses, and place in metres. False: before the first pose, after
 * the last one, or in a gap of more than a quarter of a second. Any thread.
 */
bool lp_pose_file_at(const struct lp_pose_file *file, double t_s, float quaternion[4],
		     double position_m[3]);

void lp_pose_file_destroy(struct lp_pose_file *file); /* accepts NULL */

#endif
