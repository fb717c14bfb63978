/* SPDX-License-Identifier: Apache-2.0 */
/* Several cameras in one box: whether their camera files belong together. */
#ifndef LP_APP_RIG_H
#define LP_APP_RIG_H

struct lp_camera_file;

/* 0; -EINVAL, logged with the next step: a file of another rig, or two of one place. Files that
 * no rig was calibrated with may be together. */
int lp_rig_check(const struct lp_camera_file *const *files, int count);

/* How well the cameras' rotations against each other are known, 1 sigma, of the one known worst. */
float lp_rig_sigma_deg(const struct lp_camera_file *const *files, int count);

#endif
