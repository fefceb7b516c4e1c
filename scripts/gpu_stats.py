"""Compiles pipelines for AMD GPUs with RADV's null device and compares them with a stored table; see
scripts/gpu-stats. PIPELINES.json is written by the suite's test `pipelines`."""

import argparse
import base64
import csv
import glob
import hashlib
import json
import os
import subprocess
import sys
import tempfile

GPUS = ["gfx1100", "navi21", "vega10"]
# GPU that a check compiles for: spills and waves on the others follow it.
CHECKED = ["navi21"]
# Column names, and RADV's names of these statistics.
NUMBERS = {
    "registers": "VGPRs",
    "spilled": "Spilled VGPRs",
    "spilled_scalars": "Spilled SGPRs",
    "scratch": "Scratch size",
    "waves": "Subgroups per SIMD",
    "instructions": "Instructions",
}
KEY = ["shader", "constants", "targets", "stage"]
# Column of the hash of a pipeline: a check compiles those that the stored table does not have.
CODE = "pipeline"
# Stages in the printed table.
ROWS = 40


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pipelines")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--gpu", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.gpu:
        return print(json.dumps(compile_all(options.pipelines, options.gpu)))
    if options.check and not options.write:
        GPUS[:] = CHECKED
    with open(options.pipelines) as file:
        pipelines = json.load(file)
    version = measure([])[0]
    folder = os.path.join("docs", "gpu-stats")
    table = os.path.join(folder, f"mesa-{version}.csv")
    known = read(table) if options.check and not options.write and not options.only else []
    codes = {code_of(pipeline) for pipeline in pipelines}
    rows = [row for row in known if row[CODE] in codes]
    have = {row[CODE] for row in rows}
    new = [pipeline for pipeline in pipelines if code_of(pipeline) not in have]
    print(f"{len(pipelines)} pipelines, {len(new)} to compile")
    rows = sorted(rows + measure(new)[1], key=lambda row: tuple(row[k] for k in KEY))
    print_table(version, [row for row in rows if options.only in row["shader"]], options.only)
    if options.check and not check(rows, table, version):
        sys.exit(1)
    if options.write:
        os.makedirs(folder, exist_ok=True)
        write(rows, table)
        print(f"written: {table}")


def code_of(pipeline):
    return hashlib.sha256(json.dumps(pipeline, sort_keys=True).encode()).hexdigest()[:16]


def measure(pipelines):
    """Returns the Mesa version and a row for each stage, with the numbers of all GPUs."""
    rows = {}
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump(pipelines, file)
        file.flush()
        # The driver reads the GPU's name once per process.
        children = [
            subprocess.Popen([sys.executable, __file__, file.name, "--gpu", gpu], stdout=subprocess.PIPE)
            for gpu in GPUS
        ]
        for gpu, child in zip(GPUS, children):
            output = child.communicate()[0]
            if child.returncode:
                sys.exit(f"gpu-stats: compiling for {gpu} failed; the error stands above")
            made = json.loads(output)
            for stage in made["stages"]:
                row = rows.setdefault(tuple(stage[k] for k in KEY), {k: stage[k] for k in KEY + [CODE]})
                row.update({f"{gpu}_{name}": stage[name] for name in NUMBERS})
    return made["mesa"], list(rows.values())


def read(path):
    """Returns the rows of a stored table that name their pipelines."""
    if not os.path.exists(path):
        return []
    with open(path, newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.get(CODE)]
    numbers = [f"{gpu}_{name}" for gpu in GPUS for name in NUMBERS]
    return [{**{k: row[k] for k in KEY + [CODE]}, **{n: int(row[n]) for n in numbers}} for row in rows]


def print_table(version, rows, everything):
    rows = sorted(rows, key=lambda row: -row[f"{GPUS[0]}_registers"])
    shown = rows if everything else rows[:ROWS]
    print(f"RADV of Mesa {version}: {len(rows)} stages, the first {len(shown)} by registers")
    print("| " + " | ".join(KEY) + " | " + " | ".join(
        f"{gpu}: registers | spilled, scratch | waves | instructions" for gpu in GPUS) + " |")
    print("|" + " --- |" * len(KEY) + " --- | --- | --- | --- |" * len(GPUS))
    for row in shown:
        cells = [row[k] for k in KEY]
        for gpu in GPUS:
            at = {name: row[f"{gpu}_{name}"] for name in NUMBERS}
            spilled = f"{at['spilled'] + at['spilled_scalars']}, {at['scratch']}"
            cells += [at["registers"], spilled, at["waves"], at["instructions"]]
        print("| " + " | ".join(map(str, cells)) + " |")


def write(rows, path):
    with open(path + ".partial", "w", newline="") as file:
        columns = KEY + [CODE] + [f"{gpu}_{name}" for gpu in GPUS for name in NUMBERS]
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(path + ".partial", path)


def check(rows, path, version):
    """Prints what is worse than in the stored table; returns whether nothing is."""
    if not os.path.exists(path):
        print(f"no stored table for Mesa {version} ({path}): nothing to compare with")
        return True
    with open(path, newline="") as file:
        stored = {tuple(row[k] for k in KEY): row for row in csv.DictReader(file)}
    worse = []
    for row in rows:
        key = tuple(row[k] for k in KEY)
        before = stored.pop(key, None)
        if before is None:
            print(f"not in {path}: {name_of(key)}; scripts/gpu-stats --write adds it")
        for gpu in GPUS:
            for name in ["spilled", "spilled_scalars", "scratch", "waves"]:
                column = f"{gpu}_{name}"
                now, then = row[column], int(before[column]) if before else 0
                if now < then if name == "waves" else now > then:
                    worse.append(f"{name_of(key)}: {gpu}: {name} {then}, now {now}")
    for key in stored:
        print(f"no longer used: {name_of(key)}; scripts/gpu-stats --write removes it")
    for line in worse:
        print(f"worse than in {path}: {line}")
    if worse:
        print("if that is intended, store the new numbers with scripts/gpu-stats --write")
    else:
        print(f"no new spills and no fewer waves than in {path}")
    return not worse


def name_of(key):
    return " ".join(part for part in key if part)


def compile_all(pipelines, gpu):
    """Returns the Mesa version and the statistics of each stage on this GPU."""
    drivers = glob.glob("/usr/share/vulkan/icd.d/radeon_icd*.json")
    if not drivers:
        sys.exit("gpu-stats: Mesa's RADV is not installed (Debian: apt install mesa-vulkan-drivers)")
    os.environ["VK_ICD_FILENAMES"] = drivers[0]
    os.environ["RADV_FORCE_FAMILY"] = gpu
    # Every pipeline is compiled: a cached one may come from another version of the shader.
    os.environ["MESA_SHADER_CACHE_DISABLE"] = "true"
    with open(pipelines) as file:
        pipelines = json.load(file)
    device = Device()
    stages = []
    for pipeline in pipelines:
        stages += device.compile(pipeline)
    return {"mesa": device.version, "stages": stages}


class Device:
    """RADV without a card, with the features that wgpu enables."""

    def __init__(self):
        import vulkan as vk

        self.vk = vk
        application = vk.VkApplicationInfo(apiVersion=vk.VK_MAKE_VERSION(1, 3, 0))
        instance = vk.vkCreateInstance(vk.VkInstanceCreateInfo(pApplicationInfo=application), None)
        card = vk.vkEnumeratePhysicalDevices(instance)[0]
        number = vk.vkGetPhysicalDeviceProperties(card).driverVersion
        self.version = f"{number >> 22}.{(number >> 12) & 0x3FF}.{number & 0xFFF}"
        more = vk.VkPhysicalDevicePipelineExecutablePropertiesFeaturesKHR(pipelineExecutableInfo=1)
        more = vk.VkPhysicalDeviceRobustness2FeaturesEXT(
            robustBufferAccess2=1, robustImageAccess2=1, pNext=more)
        more = vk.VkPhysicalDeviceVulkan13Features(dynamicRendering=1, robustImageAccess=1, pNext=more)
        core = vk.VkPhysicalDeviceFeatures(
            robustBufferAccess=1, fragmentStoresAndAtomics=1, vertexPipelineStoresAndAtomics=1,
            independentBlend=1)
        queue = vk.VkDeviceQueueCreateInfo(queueFamilyIndex=0, pQueuePriorities=[1.0], queueCount=1)
        self.device = vk.vkCreateDevice(card, vk.VkDeviceCreateInfo(
            pNext=more, pEnabledFeatures=core, pQueueCreateInfos=[queue],
            ppEnabledExtensionNames=["VK_KHR_pipeline_executable_properties", "VK_EXT_robustness2"],
        ), None)
        function = lambda name: vk.vkGetDeviceProcAddr(self.device, name)
        self.executables = function("vkGetPipelineExecutablePropertiesKHR")
        self.statistics = function("vkGetPipelineExecutableStatisticsKHR")

    def compile(self, pipeline):
        vk = self.vk
        constants = " ".join(
            f"{name}={value:g}" for name, value in sorted(pipeline["constants"].items()))
        targets = " ".join(pipeline["targets"] + ([pipeline["depth"]] if pipeline["depth"] else []))
        stages = [self.stage(stage) for stage in pipeline["stages"]]
        layout = self.layout(pipeline["bindings"])
        made = self.draw(pipeline, stages, layout) if pipeline["targets"] or pipeline["depth"] else (
            vk.vkCreateComputePipelines(self.device, None, 1, [vk.VkComputePipelineCreateInfo(
                flags=vk.VK_PIPELINE_CREATE_CAPTURE_STATISTICS_BIT_KHR, stage=stages[0],
                layout=layout, basePipelineIndex=-1)], None)[0])
        info = vk.VkPipelineInfoKHR(pipeline=made)
        rows = []
        for index, executable in enumerate(self.executables(self.device, info)):
            asked = vk.VkPipelineExecutableInfoKHR(pipeline=made, executableIndex=index)
            numbers = {text(s.name): s.value.u64 for s in self.statistics(self.device, asked)}
            row = {name: numbers.get(theirs, 0) for name, theirs in NUMBERS.items()}
            stage = text(executable.name).lower().replace(" shader", "").replace("pixel", "fragment")
            rows.append({"shader": pipeline["shader"], "constants": constants, "targets": targets,
                         "stage": stage, CODE: code_of(pipeline), **row})
        return rows

    def stage(self, stage):
        vk = self.vk
        code = base64.b64decode(stage["spirv"])
        module = vk.vkCreateShaderModule(
            self.device, vk.VkShaderModuleCreateInfo(codeSize=len(code), pCode=code), None)
        kind = {"compute": vk.VK_SHADER_STAGE_COMPUTE_BIT, "vertex": vk.VK_SHADER_STAGE_VERTEX_BIT,
                "fragment": vk.VK_SHADER_STAGE_FRAGMENT_BIT}[stage["stage"]]
        return vk.VkPipelineShaderStageCreateInfo(stage=kind, module=module, pName=stage["entry"])

    def layout(self, bindings):
        vk = self.vk
        kinds = {
            "uniform": vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER,
            "storage": vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
            "sampler": vk.VK_DESCRIPTOR_TYPE_SAMPLER,
            "sampled image": vk.VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE,
            "storage image": vk.VK_DESCRIPTOR_TYPE_STORAGE_IMAGE,
        }
        entries = [vk.VkDescriptorSetLayoutBinding(
            binding=number, descriptorType=kinds[kind], descriptorCount=1,
            stageFlags=vk.VK_SHADER_STAGE_ALL) for number, kind in bindings]
        group = vk.vkCreateDescriptorSetLayout(
            self.device, vk.VkDescriptorSetLayoutCreateInfo(pBindings=entries), None)
        return vk.vkCreatePipelineLayout(
            self.device, vk.VkPipelineLayoutCreateInfo(pSetLayouts=[group]), None)

    def draw(self, pipeline, stages, layout):
        vk = self.vk
        formats = [format_of(vk, name) for name in pipeline["targets"]]
        depth = format_of(vk, pipeline["depth"]) if pipeline["depth"] else vk.VK_FORMAT_UNDEFINED
        blends = [vk.VkPipelineColorBlendAttachmentState(colorWriteMask=15) for _ in formats]
        return vk.vkCreateGraphicsPipelines(self.device, None, 1, [vk.VkGraphicsPipelineCreateInfo(
            flags=vk.VK_PIPELINE_CREATE_CAPTURE_STATISTICS_BIT_KHR,
            pNext=vk.VkPipelineRenderingCreateInfo(
                colorAttachmentCount=len(formats), pColorAttachmentFormats=formats,
                depthAttachmentFormat=depth),
            pStages=stages,
            pVertexInputState=vk.VkPipelineVertexInputStateCreateInfo(),
            pInputAssemblyState=vk.VkPipelineInputAssemblyStateCreateInfo(
                topology=vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST),
            pViewportState=vk.VkPipelineViewportStateCreateInfo(
                viewportCount=1, pViewports=[vk.VkViewport(0, 0, 512, 512, 0, 1)],
                scissorCount=1,
                pScissors=[vk.VkRect2D(vk.VkOffset2D(0, 0), vk.VkExtent2D(512, 512))]),
            pRasterizationState=vk.VkPipelineRasterizationStateCreateInfo(lineWidth=1.0),
            pMultisampleState=vk.VkPipelineMultisampleStateCreateInfo(rasterizationSamples=1),
            pDepthStencilState=vk.VkPipelineDepthStencilStateCreateInfo(
                depthTestEnable=int(bool(pipeline["depth"])), depthWriteEnable=1,
                depthCompareOp=vk.VK_COMPARE_OP_LESS),
            pColorBlendState=vk.VkPipelineColorBlendStateCreateInfo(pAttachments=blends),
            layout=layout, basePipelineIndex=-1)], None)[0]


def text(name):
    import vulkan

    return name if isinstance(name, str) else vulkan.ffi.string(name).decode()


def format_of(vk, name):
    """Returns the Vulkan format of a wgpu format, by its name there."""
    known = {
        "Rgba8Unorm": vk.VK_FORMAT_R8G8B8A8_UNORM,
        "Rgba8UnormSrgb": vk.VK_FORMAT_R8G8B8A8_SRGB,
        "Bgra8Unorm": vk.VK_FORMAT_B8G8R8A8_UNORM,
        "R8Unorm": vk.VK_FORMAT_R8_UNORM,
        "R16Float": vk.VK_FORMAT_R16_SFLOAT,
        "Rgba16Float": vk.VK_FORMAT_R16G16B16A16_SFLOAT,
        "R32Float": vk.VK_FORMAT_R32_SFLOAT,
        "Rg32Float": vk.VK_FORMAT_R32G32_SFLOAT,
        "Rgba32Float": vk.VK_FORMAT_R32G32B32A32_SFLOAT,
        "R32Uint": vk.VK_FORMAT_R32_UINT,
        "Rg32Uint": vk.VK_FORMAT_R32G32_UINT,
        "Rgba32Uint": vk.VK_FORMAT_R32G32B32A32_UINT,
        "Depth32Float": vk.VK_FORMAT_D32_SFLOAT,
    }
    if name not in known:
        sys.exit(f"gpu-stats: the format {name} of a draw is unknown; add it to format_of")
    return known[name]


if __name__ == "__main__":
    main()
