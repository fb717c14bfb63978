// SPDX-License-Identifier: Apache-2.0
// The component for Unity among the stubs, in the pipeline that the first word names: what it sets and says in three frames. With
// an address: the mean radiance of the ambient light in each frame, as many as there are lines on standard input, each the time
// that has passed in seconds; then its status.
using System;
using System.Globalization;
using System.Reflection;
using Lightprobe;
using UnityEngine;
using UnityEngine.Rendering;

static class Receiver
{
    static void Main(string[] arguments)
    {
        var receiver = new LightProbeReceiver();
        Field("pipeline").SetValue(receiver, Enum.Parse(typeof(Pipeline), arguments[0]));
        if (arguments.Length > 1) Field("address").SetValue(receiver, arguments[1]);
        Call(receiver, "OnEnable");
        if (arguments.Length > 1) Frames(receiver);
        else
            for (int frame = 0; frame < 3; frame++) Call(receiver, "Update");
        if (arguments.Length == 1)
        {
            Console.WriteLine(Debug.Warnings + " " + RenderSettings.Probes + " " + (RenderSettings.ambientMode == AmbientMode.Custom) + " " + GraphicsSettings.lightsUseLinearIntensity);
            Console.WriteLine(Debug.Warning ?? "-");
        }
        Call(receiver, "OnDisable");
    }

    static void Frames(LightProbeReceiver receiver)
    {
        for (string line; (line = Console.ReadLine()) != null;)
        {
            UnityEngine.Time.deltaTime = float.Parse(line, CultureInfo.InvariantCulture);
            Call(receiver, "Update");
            Console.WriteLine("[" + RenderSettings.ambientProbe[0, 0].ToString("R", CultureInfo.InvariantCulture) + ",\"" + receiver.Status + "\"]");
        }
    }

    static FieldInfo Field(string name) => typeof(LightProbeReceiver).GetField(name, BindingFlags.NonPublic | BindingFlags.Instance);

    static void Call(LightProbeReceiver receiver, string name) =>
        typeof(LightProbeReceiver).GetMethod(name, BindingFlags.NonPublic | BindingFlags.Instance).Invoke(receiver, null);
}
