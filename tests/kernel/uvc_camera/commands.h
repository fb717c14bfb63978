/* SPDX-License-Identifier: Apache-2.0 */
/* Text commands on a Unix socket, one a line; each is answered by "ok ..." or "error ...". */
#ifndef UVC_CAMERA_COMMANDS_H
#define UVC_CAMERA_COMMANDS_H

#include "camera.h"

extern const char commands_help[];

/* Serves one client after another until `quit`. 0 or -errno. */
int commands_serve(struct camera *camera, const struct camera_options *options);

#endif
