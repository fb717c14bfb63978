/* SPDX-License-Identifier: Apache-2.0 */
/* Gives one target the files of a folder, in place of libFuzzer: `make test` has no clang runtime,
 * and what once found something must not come back. */
#include "fuzz.h"

#include <dirent.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define MOST_BYTES (1U << 20)

/* An input is exactly as long as its memory: what is beyond it is a fault. */
static void replay(const char *path)
{
	static uint8_t data[MOST_BYTES];
	FILE *file = fopen(path, "rb");
	uint8_t *input;
	size_t size;

	fuzz_assert(file != NULL);
	size = fread(data, 1, sizeof(data), file);
	(void)fclose(file);
	input = malloc(size ? size : 1);
	fuzz_assert(input != NULL);
	memcpy(input, data, size);
	(void)LLVMFuzzerTestOneInput(input, size);
	free(input);
}

int main(int argc, char **argv)
{
	DIR *folder = argc == 2 ? opendir(argv[1]) : NULL;
	const struct dirent *entry;
	char path[4096];
	int count = 0;

	if (!folder) {
		(void)fprintf(stderr, "usage: %s FOLDER — a folder of inputs\n", argv[0]);
		return 2;
	}
	while ((entry = readdir(folder)) != NULL) {
		if (entry->d_name[0] == '.')
			continue;
		(void)snprintf(path, sizeof(path), "%s/%s", argv[1], entry->d_name);
		(void)fprintf(stderr, "%s\n",
			      path); /* the last one printed is the one that broke it */
		replay(path);
		count++;
	}
	(void)closedir(folder);
	return count ? 0 : 1;
}
