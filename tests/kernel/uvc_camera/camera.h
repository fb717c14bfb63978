/* SPDX-License-Identifier: Apache-2.0 */
/* The whole camera: plugged or not, answering the host's control requests on a thread of its own.
 */
#ifndef UVC_CAMERA_CAMERA_H
#define UVC_CAMERA_CAMERA_H

#include "controls.h"
#include "faults.h"
#include "model.h"
#include "pictures.h"
#include "streaming.h"

struct camera;

/* `options` and `pictures` are borrowed. NULL: no memory. */
struct camera *camera_create(const struct camera_options *options, struct pictures *pictures);
void camera_destroy(struct camera *camera); /* accepts NULL; unplugs */

/* Both 0 or -errno: -EALREADY when it is so. `controller` names the device side of the bus. */
int camera_plug(struct camera *camera, const char *controller);
int camera_unplug(struct camera *camera);

struct faults *camera_faults(struct camera *camera);
struct controls *camera_controls(struct camera *camera);
const struct streaming_counts *camera_counts(const struct camera *camera);

#endif
