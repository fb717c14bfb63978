// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * Gives emulated devices the place in the firmware's tree that a real USB controller has: libcamera
 * names cameras by it. The place is that of the PCI bus; devices may share it, as controllers do.
 */
#include <linux/acpi.h>
#include <linux/module.h>
#include <linux/platform_device.h>

static const char *const names[] = {"dummy_hcd.0", "dummy_hcd.1"};
static struct device *bound[ARRAY_SIZE(names)];

static void unbind_all(void)
{
	int i;

	for (i = 0; i < ARRAY_SIZE(names); i++) {
		if (!bound[i])
			continue;
		acpi_unbind_one(bound[i]);
		put_device(bound[i]);
	}
}

static int bind_to(struct acpi_device *place, int i)
{
	struct device *device = bus_find_device_by_name(&platform_bus_type, NULL, names[i]);
	int ret = device ? acpi_bind_one(device, place) : -ENODEV;

	if (ret)
		put_device(device);
	else
		bound[i] = device;
	return ret;
}

static int __init firmware_node_init(void)
{
	struct acpi_device *place = acpi_dev_get_first_match_dev("PNP0A03", NULL, -1);
	int ret = place ? 0 : -ENODEV;
	int i;

	for (i = 0; !ret && i < ARRAY_SIZE(names); i++)
		ret = bind_to(place, i);
	if (place)
		acpi_dev_put(place);
	if (ret)
		unbind_all();
	return ret;
}

static void __exit firmware_node_exit(void)
{
	unbind_all();
}

module_init(firmware_node_init);
module_exit(firmware_node_exit);
MODULE_DESCRIPTION("A firmware node for emulated USB controllers");
MODULE_LICENSE("GPL");
