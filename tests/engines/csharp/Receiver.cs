// SPDX-License-Identifier: Apache-2.0
// The component for Unity among the stubs, in the pipeline that the first word names: what it sets and says in three frames.
using System;
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
        Call(receiver, "OnEnable");
        for (int frame = 0; frame < 3; frame++) Call(receiver, "Update");
        Call(receiver, "OnDisable");
        Console.WriteLine(Debug.Warnings + " " + RenderSettings.Probes + " " + (RenderSettings.ambientMode == AmbientMode.Custom) + " " + GraphicsSettings.lightsUseLinearIntensity);
        Console.WriteLine(Debug.Warning ?? "-");
    }

    static FieldInfo Field(string name) => typeof(LightProbeReceiver).GetField(name, BindingFlags.NonPublic | BindingFlags.Instance);

    static void Call(LightProbeReceiver receiver, string name) =>
        typeof(LightProbeReceiver).GetMethod(name, BindingFlags.NonPublic | BindingFlags.Instance).Invoke(receiver, null);
}
