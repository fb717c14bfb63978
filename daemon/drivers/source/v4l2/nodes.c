/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/nodes.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Of cameras among which the user has to choose. */
#define MOST_LISTED 3

/* First line of a small file; "" when there is none. */
static void read_attribute(const char *folder, const char *name, char *text, size_t size_bytes)
{
	char path[PATH_MAX];
	ssize_t length;
	int fd;

	text[0] = '\0';
	snprintf(path, sizeof(path), "%s/%s", folder, name);
	fd = open(path, O_RDONLY | O_CLOEXEC);
	if (fd < 0)
		return;
	length = read(fd, text, size_bytes - 1);
	close(fd);
	text[length > 0 ? length : 0] = '\0';
	text[strcspn(text, "\n")] = '\0';
}

static int read_number(const char *folder, const char *name, int base)
{
	char text[16];

	read_attribute(folder, name, text, sizeof(text));
	return (int)strtol(text, NULL, base);
}

/* As udev writes strings into links: blanks become one '_', what is not plain is replaced. */
static void append_id(char *id_name, size_t size_bytes, const char *text)
{
	size_t used = strlen(id_name);
	bool gap = false;

	while (*text == ' ')
		text++;
	for (; *text && used + 2 < size_bytes; text++) {
		const unsigned char c = (unsigned char)*text;

		if (isspace(c)) {
			gap = true;
			continue;
		}
		if (gap)
			id_name[used++] = '_';
		gap = false;
		id_name[used++] = isalnum(c) || strchr("#+-.:=@_", c) ? (char)c : '_';
	}
	id_name[used] = '\0';
}

static void read_id_name(const char *device, struct lp_v4l2_node *node)
{
	char maker[64], model[64], number[8];
	const size_t size = sizeof(node->id_name) - sizeof("-video-index0");

	read_attribute(device, "manufacturer", maker, sizeof(maker));
	read_attribute(device, "product", model, sizeof(model));
	snprintf(node->id_name, size, "usb-");
	snprintf(number, sizeof(number), "%04x", node->vendor);
	append_id(node->id_name, size, *maker ? maker : number);
	append_id(node->id_name, size, "_");
	snprintf(number, sizeof(number), "%04x", node->product);
	append_id(node->id_name, size, *model ? model : number);
	if (*node->serial) {
		append_id(node->id_name, size, "_");
		append_id(node->id_name, size, node->serial);
	}
	snprintf(node->id_name + strlen(node->id_name), sizeof("-video-index0"), "-video-index0");
}

/* The node's parent is an interface of the USB device, whose own folder is one up. */
static void read_usb(const char *class_folder, struct lp_v4l2_node *node)
{
	char link[PATH_MAX + 16], device[PATH_MAX], id[8];

	snprintf(link, sizeof(link), "%s/device/..", class_folder);
	if (!realpath(link, device))
		return;
	read_attribute(device, "idVendor", id, sizeof(id));
	if (!*id)
		return;
	node->usb = true;
	node->vendor = (uint16_t)strtoul(id, NULL, 16);
	node->product = (uint16_t)read_number(device, "idProduct", 16);
	node->bus = read_number(device, "busnum", 10);
	node->address = read_number(device, "devnum", 10);
	read_attribute(device, "serial", node->serial, sizeof(node->serial));
	snprintf(node->port, sizeof(node->port), "%.31s", strrchr(device, '/') + 1);
	read_id_name(device, node);
}

static bool read_node(const char *sysfs, const char *name, struct lp_v4l2_node *node)
{
	char folder[PATH_MAX], index[8];

	snprintf(folder, sizeof(folder), "%s/class/video4linux/%s", sysfs, name);
	read_attribute(folder, "index", index, sizeof(index));
	if (strcmp(index, "0") != 0)
		return false; /* gone meanwhile, or the camera's second node, for metadata */
	*node = (struct lp_v4l2_node){0};
	snprintf(node->path, sizeof(node->path), "/dev/%.50s", name);
	read_attribute(folder, "name", node->name, sizeof(node->name));
	read_usb(folder, node);
	return true;
}

static int by_path(const void *a, const void *b)
{
	const struct lp_v4l2_node *one = a, *other = b;

	return strverscmp(one->path, other->path);
}

static bool is_same_kind(const struct lp_v4l2_node *node, const struct lp_v4l2_node *other)
{
	return node->usb && other->usb && node->vendor == other->vendor &&
	       node->product == other->product && !strcmp(node->serial, other->serial);
}

/* Cheap modules of one make have one serial number, or none. */
static void find_twins(struct lp_v4l2_node *nodes, int count)
{
	for (int i = 0; i < count; i++)
		for (int k = 0; k < count; k++)
			nodes[i].has_twin |= k != i && is_same_kind(&nodes[i], &nodes[k]) &&
					     strcmp(nodes[i].port, nodes[k].port) != 0;
}

int lp_v4l2_nodes_read(const char *sysfs, struct lp_v4l2_node *nodes, int capacity)
{
	char folder[PATH_MAX];
	struct dirent *entry;
	int count = 0;
	DIR *stream;

	snprintf(folder, sizeof(folder), "%s/class/video4linux", sysfs);
	stream = opendir(folder);
	if (!stream)
		return 0;
	while (count < capacity && (entry = readdir(stream))) {
		if (!strncmp(entry->d_name, "video", 5) &&
		    read_node(sysfs, entry->d_name, &nodes[count]))
			count++;
	}
	closedir(stream);
	qsort(nodes, (size_t)count, sizeof(*nodes), by_path);
	find_twins(nodes, count);
	return count;
}

/* ---------------------------------------------------------------- which one is meant */

/* Only the port says which one is meant. */
static bool is_by_port(const struct lp_v4l2_target *target, const struct lp_v4l2_node *known)
{
	return known->usb && (known->has_twin || target->kind == LP_V4L2_PORT ||
			      (target->kind == LP_V4L2_PATH && strstr(target->text, "/by-path/")));
}

static bool is_same_device(const struct lp_v4l2_node *node, const struct lp_v4l2_node *known,
			   const struct lp_v4l2_target *target)
{
	if (!known->usb || !node->usb)
		return !known->usb && !node->usb && !strcmp(node->path, known->path);
	return is_same_kind(node, known) &&
	       (!is_by_port(target, known) || !strcmp(node->port, known->port));
}

/* A link is followed; a path that does not exist stands for itself. */
static bool is_at_path(const struct lp_v4l2_node *node, const char *path)
{
	char real[PATH_MAX];

	return !strcmp(node->path, realpath(path, real) ? real : path);
}

static bool is_meant(const struct lp_v4l2_node *node, const struct lp_v4l2_target *target)
{
	switch (target->kind) {
	case LP_V4L2_PATH:
		return is_at_path(node, target->text);
	case LP_V4L2_ID_NAME:
		return !strcmp(node->id_name, target->text);
	case LP_V4L2_USB:
		return node->usb && node->vendor == target->usb.vendor &&
		       node->product == target->usb.product &&
		       (!*target->serial || !strcmp(node->serial, target->serial));
	case LP_V4L2_PORT:
		return node->usb && !strcmp(node->port, target->port);
	case LP_V4L2_ANY:
		return true;
	}
	return false;
}

static void list_nodes(const struct lp_v4l2_node *nodes, int count, char *text, size_t size_bytes)
{
	size_t used =
		(size_t)snprintf(text, size_bytes, count ? "present:" : "no camera is present");

	for (int i = 0; i < count && used < size_bytes; i++) {
		const struct lp_v4l2_node *node = &nodes[i];

		used += (size_t)snprintf(text + used, size_bytes - used, "%s %s (%s", i ? "," : "",
					 node->path, node->name);
		if (node->usb && used < size_bytes)
			used += (size_t)snprintf(text + used, size_bytes - used,
						 ", %04x:%04x:%s, port %s", node->vendor,
						 node->product, node->serial, node->port);
		if (used < size_bytes)
			used += (size_t)snprintf(text + used, size_bytes - used, ")");
	}
}

/* Those that match, short: health messages must hold all of it. */
static void refuse_several(const struct lp_v4l2_node *const *nodes, int count, char *reason,
			   size_t reason_bytes)
{
	const char *port = nodes[0]->port;
	size_t used = (size_t)snprintf(reason, reason_bytes, "several cameras match:");

	for (int i = 0; i < count && used < reason_bytes; i++) {
		const struct lp_v4l2_node *node = nodes[i];

		used += (size_t)snprintf(reason + used, reason_bytes - used,
					 node->usb ? "%s %s (%04x:%04x:%s, port %s)" : "%s %s",
					 i ? "," : "", node->path, node->vendor, node->product,
					 node->serial, node->port);
	}
	if (used < reason_bytes)
		snprintf(reason + used, reason_bytes - used,
			 *port ? " — name one by its port, like v4l2:port:%s"
			       : " — name one by path",
			 port);
}

int lp_v4l2_nodes_select(const struct lp_v4l2_node *nodes, int count,
			 const struct lp_v4l2_target *target, const struct lp_v4l2_node *known,
			 char *reason, size_t reason_bytes)
{
	const struct lp_v4l2_node *several[MOST_LISTED];
	int found = -1, matches = 0;
	char list[260]; /* what to do follows it: that must fit, too */

	for (int i = 0; i < count; i++) {
		if (!(known ? is_same_device(&nodes[i], known, target)
			    : is_meant(&nodes[i], target)))
			continue;
		if (known && !strcmp(nodes[i].port, known->port))
			return i; /* the same camera in the same place */
		if (matches < MOST_LISTED)
			several[matches] = &nodes[i];
		matches++;
		found = i;
	}
	if (matches == 1)
		return found;
	list_nodes(nodes, count, list, sizeof(list));
	if (matches == 0) {
		if (known && is_by_port(target, known))
			snprintf(reason, reason_bytes,
				 "unplugged from port %s — replug it there; %s", known->port, list);
		else if (known && count)
			snprintf(reason, reason_bytes,
				 "%s is unplugged; %s — replug it, or restart lightprobed to use "
				 "another one",
				 known->name, list);
		else if (known)
			snprintf(reason, reason_bytes,
				 "%s is unplugged: waiting for it to come back", known->name);
		else
			snprintf(reason, reason_bytes, "no such device; %s", list);
		return -ENOENT;
	}
	refuse_several(several, matches < MOST_LISTED ? matches : MOST_LISTED, reason,
		       reason_bytes);
	return -ENOTUNIQ;
}
