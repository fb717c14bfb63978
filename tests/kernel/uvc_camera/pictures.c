/* SPDX-License-Identifier: Apache-2.0 */
#include "pictures.h"
#include <stdio.h>
#include <string.h>

struct pictures *pictures_create(const char *uri)
{
	if (strcmp(uri, "pattern:") == 0)
		return pictures_pattern_create();
	if (strncmp(uri, "folder:", 7) == 0)
		return pictures_folder_create(uri + 7);
	if (strncmp(uri, "sim:", 4) == 0)
		return pictures_simulator_create(uri + 4);
	fprintf(stderr, "uvc_camera: %s: not pattern:, folder:PATH or sim:PATH\n", uri);
	return NULL;
}

int pictures_take(struct pictures *pictures, enum camera_format format,
		  const struct camera_size *size, const struct settings *settings,
		  struct picture *picture)
{
	return pictures->ops->take(pictures, format, size, settings, picture);
}

void pictures_destroy(struct pictures *pictures)
{
	if (pictures)
		pictures->ops->destroy(pictures);
}
