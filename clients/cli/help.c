/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/help.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

/* Blocks of the help, in the order in which they are printed. */
enum block {
    BLOCK_LOAD,
    BLOCK_UPLOAD,
    BLOCK_SCENE,
    BLOCK_IMAGE,
    BLOCK_LOCAL,
    BLOCK_CONVERT,
    BLOCK_SLICE,
    BLOCK_PATH,
    BLOCK_MEASURES,
    BLOCK_DELETE,
    BLOCK_DAEMON,
    BLOCK_OUTPUT,
    BLOCK_FIELDS,
    BLOCKS
};

#define BIT(block) (1u << (block))
#define DAEMON (BIT(BLOCK_DAEMON) | BIT(BLOCK_OUTPUT))

static const struct {
    const char *name, *arguments;
    const char *about; /* further lines are indented as the list is */
    unsigned blocks;
} commands[] = {
    { "volumes", "", "list the daemon's volumes", DAEMON },
    { "load", "SOURCE",
      "load a file below the daemon's --data folder, demo:NAME, or the address\n"
      "of an OME-Zarr on a host that the daemon allows (--allow-host); print\n"
      "its id and wait until it is ready",
      DAEMON | BIT(BLOCK_LOAD) },
    { "upload", "FILE...",
      "upload a file of this computer and open it; print its id. A header\n"
      "(.nhdr, .json, .mhd, .hdr, .vgi) is followed by the files with its\n"
      "samples, a file of a DICOM series or a slice by the others. If it\n"
      "is interrupted, the same command continues",
      DAEMON | BIT(BLOCK_LOAD) | BIT(BLOCK_UPLOAD) },
    { "info", "SOURCE",
      "print what the daemon would read from a file, demo:NAME or the address\n"
      "of an OME-Zarr, with a histogram; without a daemon",
      BIT(BLOCK_OUTPUT) },
    { "convert", "SOURCE OUT",
      "write a volume (a file, demo:NAME, the address of an OME-Zarr) in\n"
      "another format, without a daemon. OUT ends with:\n"
      ".bricks, from which the daemon shows volumes that are larger than\n"
      "its memory; .nrrd (raw); .nii or .nii.gz; .vdb (OpenVDB);\n"
      ".ome.zarr or .zarr, a folder with a pyramid, which replaces only\n"
      "what convert wrote",
      BIT(BLOCK_CONVERT) },
    { "unload", "ID", "remove a volume from the daemon", DAEMON },
    { "view", "ID", "print the default view of a volume", DAEMON | BIT(BLOCK_FIELDS) },
    { "render", "", "render one image",
      DAEMON | BIT(BLOCK_SCENE) | BIT(BLOCK_IMAGE) | BIT(BLOCK_LOCAL) | BIT(BLOCK_FIELDS) },
    { "slice", "", "write one slice of a volume, as an image or as values",
      DAEMON | BIT(BLOCK_SLICE) },
    { "path", "FILE|-",
      "render a camera path: frames into the folder --out, or a movie;\n"
      "the daemon keeps the path until everything is fetched",
      DAEMON | BIT(BLOCK_PATH) | BIT(BLOCK_DELETE) },
    { "path", "--id ID",
      "fetch a path into --out; it stays on the daemon. Without --out:\n"
      "print its state",
      DAEMON | BIT(BLOCK_PATH) | BIT(BLOCK_DELETE) },
    { "paths", "", "list the camera paths", DAEMON },
    { "save", "", "save a view (--view, --volume) for links; print its id",
      DAEMON | BIT(BLOCK_SCENE) | BIT(BLOCK_FIELDS) },
    { "saved", "ID", "print a saved view", DAEMON | BIT(BLOCK_DELETE) },
    { "views", "", "list the saved views", DAEMON },
    { "preset", "NAME", "print a preset, or store --view FILE|- under the name",
      DAEMON | BIT(BLOCK_DELETE) },
    { "presets", "", "list the presets", DAEMON },
    { "share", "[ID]",
      "create a session from a view (--view, --volume), or from the view\n"
      "of a session or a saved view; print its links",
      DAEMON | BIT(BLOCK_SCENE) | BIT(BLOCK_FIELDS) },
    { "session", "ID", "print the links of a session", DAEMON | BIT(BLOCK_DELETE) },
    { "sessions", "", "list the sessions, active or hibernated", DAEMON },
    { "measures", "ID", "list the measurements of a session", DAEMON | BIT(BLOCK_MEASURES) },
};

static const char *const texts[BLOCKS] = {
    [BLOCK_LOAD] = "load, upload:\n"
                   "  --no-wait               return as soon as loading has started\n",
    [BLOCK_UPLOAD] = "upload:\n"
                     "  --id ID                 the id of the volume (default: by the name of the "
                     "file)\n",
    [BLOCK_SCENE] =
        "render, save, share:\n"
        "  --volume ID|SOURCE      the volume: an id, a file or demo:NAME, which is loaded if\n"
        "                          necessary (default: \"volume\" of the view).\n"
        "                          FILE?field=NAME and FILE?vectors=NAME choose one of several\n"
        "                          fields; \"splatctl info FILE\" lists them.\n"
        "                          FOLDER?series=ID chooses a DICOM series, FILE?as=KIND says\n"
        "                          what the extra axis or the components are (time, vectors,\n"
        "                          rgb, channels, labels; slice: the file alone),\n"
        "                          FILE?unit=UNIT the unit of lengths\n"
        "  --view FILE|-           a view as JSON, merged into the default view of the volume\n"
        "  --preset NAME           a preset of the daemon; --view is merged into it\n"
        "  --azimuth DEGREES       the camera around its target: 0 is the front, 90 the side at "
        "+x\n"
        "  --elevation DEGREES     the camera above its target: 90 is the top\n"
        "  --roll DEGREES          turns the image\n"
        "  --distance D            from the camera to its target, in world units\n"
        "                          (default of these four: the camera of the view)\n"
        "  --surface VALUE[,COLOR[,OPACITY]]\n"
        "                          adds the surface on which the volume has this value; the "
        "colour\n"
        "                          as RRGGBB, the opacity in [0, 1]; up to 8 times\n"
        "  --shell LOW,HIGH[,fast]\n"
        "                          adds the borders of opacity: voxels of at least the opacity "
        "LOW\n"
        "                          beside one below HIGH; fast draws squares\n"
        "  --vectors STYLE[,STRETCH[,DENSITY]]\n"
        "                          adds streaks along the vectors of the volume: modulate, or "
        "blend\n"
        "                          for one colour; kernels longer by STRETCH in [1, 8], on a "
        "share\n"
        "                          of the samples in [0, 1]. They take the place of the\n"
        "                          volume, which would hide them\n"
        "  --color-by magnitude|ID|SOURCE\n"
        "                          colours vectors and points by the length of their vectors,\n"
        "                          or by another volume with as many samples, such as\n"
        "                          FILE?field=NAME; opacities do not change\n"
        "  --channel ID|SOURCE[,COLOR[,LOW,HIGH[,OPACITY]]]\n"
        "                          mixes another volume of the same grid into the image, such as\n"
        "                          FILE?field=NAME, in a colour RRGGBB; transparent at the value\n"
        "                          LOW, as opaque as OPACITY (default 0.5) at HIGH; up to 7 times\n"
        "  --no-volume             leaves the volume out, for the other layers alone\n"
        "  --projection maximum|minimum|mean|sum\n"
        "                          one number of the values along each ray\n"
        "  --window CENTRE,WIDTH   of the projection, from black to white (default: automatic)\n"
        "  --step N                the time step of a series, from 0 (default: that of the view)\n"
        "  --size WxH              in pixels, each in [1, 8192] (default: the size of the view)\n",
    [BLOCK_IMAGE] = "render:\n"
                    "  --out FILE|-            the image file, written completely or not at all\n"
                    "  --format jpeg|png|webp|exr\n"
                    "                          (default: by the suffix of --out, else png)\n"
                    "  --quality N             1 to 100, for jpeg and webp (default 90)\n",
    [BLOCK_LOCAL] =
        "  --local                 render in this process, without a daemon; the image is the "
        "same\n"
        "  --threads N             with --local: render threads, 1 to 256 (default: one per core)\n"
        "  --backend auto|gl|gl-software|cpu|null\n"
        "                          with --local: the renderer (default: auto)\n"
        "  --gpu N                 with --local: the GPU, by its number in \"splatd --probe\"\n"
        "  --isa auto|scalar|sse41|avx2|avx512|neon\n"
        "                          with --local: instruction set of the CPU backend (default:\n"
        "                          auto)\n",
    [BLOCK_CONVERT] = "convert:\n"
                      "  --timeout SECONDS       for reading SOURCE (default 300)\n",
    [BLOCK_SLICE] =
        "slice:\n"
        "  --volume ID|SOURCE      the volume: an id, a file or demo:NAME, which is loaded if\n"
        "                          necessary\n"
        "  --out FILE|-            the file, written completely or not at all\n"
        "  --format png|jpeg|raw   raw writes the values (default: by the suffix of --out, else\n"
        "                          png)\n"
        "  --axis x|y|z            across an axis of the grid\n"
        "  --index N               with --axis: through this sample (default: the middle)\n"
        "  --step N                of this time step of a series, from 0\n"
        "  --origin X,Y,Z --normal X,Y,Z --size WxH\n"
        "                          instead of --axis: a plane in world units, and its size in\n"
        "                          pixels\n"
        "  --up X,Y,Z              with --origin: the direction upwards in the slice\n"
        "  --spacing S             with --origin: world units per pixel\n"
        "  --window CENTRE,WIDTH   the values from black to white\n",
    [BLOCK_PATH] = "path:\n"
                   "  --out FOLDER|FILE       a folder for the frames, created if necessary, or a "
                   "movie file\n",
    [BLOCK_MEASURES] =
        "measures:\n"
        "  --format csv            write a table with all numbers, for spreadsheets\n"
        "  --out FILE|-            with --format csv: the file (default: standard output)\n",
    [BLOCK_DELETE] = "saved, preset, session, path --id:\n"
                     "  --delete                delete it; path --id with --out: fetch it before\n",
    [BLOCK_DAEMON] =
        "The daemon:\n"
        "  --url URL               its address, with or without ?token= (default: $SPLATD_URL,\n"
        "                          else http://127.0.0.1:8080)\n"
        "  --token TOKEN           its token (default: that of the URL, else $SPLATD_TOKEN)\n"
        "  --timeout SECONDS       longest wait for the next bytes of an answer, for a volume, "
        "and\n"
        "                          for an unreachable daemon that renders a path (default 300)\n",
    [BLOCK_OUTPUT] = "Everywhere:\n"
                     "  --json                  print JSON on one line, for programs\n"
                     "  --help                  print the help; of one command after its name\n"
                     "  --version               print the version\n",
    [BLOCK_FIELDS] =
        "A view also chooses layers, edits, filter, compositing, light and clipping.\n"
        "\"splatctl view ID\" prints all fields; among them are:\n"
        "  layers                  [{\"type\": \"volume\"}, {\"type\": \"surface\", \"value\": "
        "120}, …]\n"
        "                          of volumes without a grid, instead of \"volume\":\n"
        "                          {\"type\": \"points\", \"size\": S}: their size, 0.1 to 10;\n"
        "                          {\"type\": \"gaussians\", \"opacity\": O, \"convention\": C}:\n"
        "                          inria or normalised;\n"
        "                          {\"type\": \"geometry\", \"opacity\": O, \"colors\": C}: own, "
        "or\n"
        "                          layer with \"color\": [R, G, B].\n"
        "                          \"id\" shows another volume, \"transform\" moves it (16 "
        "numbers)\n"
        "  edits                   [{\"type\": \"sphere\", \"center\": [X, Y, Z], \"radius\": R}, "
        "…]: cuts\n"
        "                          by plane, box and sphere, and connected parts (part)\n"
        "  filter.mode             adaptive, ewa, reconstruction, lowpass, swan, none\n"
        "  filter.kernel           gaussian, cubic\n"
        "  compositing.mode        splat, sheet, slab; projections: maximum, minimum, mean, sum\n"
        "  compositing.window      of a projection: {\"center\": C, \"width\": W}\n"
        "  compositing.attenuation exponential, linear\n"
        "  transfer_function.order pre, post (sheet, slab), auto\n"
        "  shading.smoothing       how smooth normals are, 0 to 1 (post or auto); null: automatic\n"
        "  shading.occlusion       ambient occlusion, 0 to 1 (sheet, post or auto)\n"
        "  shading.reach           how far occlusion reaches, 0.01 to 10 diagonals of the volume\n"
        "  shading.shadow          soft shadow of the first light, 0 to 1 (sheet, post or auto)\n"
        "For example, this view draws only y >= 64, in slabs half a voxel thick, and applies the\n"
        "transfer function to interpolated values:\n"
        "  {\"transfer_function\": {\"order\": \"post\"},\n"
        "   \"compositing\": {\"mode\": \"slab\", \"slab\": 0.5},\n"
        "   \"clip\": {\"planes\": [{\"normal\": [0, 1, 0], \"offset\": 64}]}}\n",
};

/* Prints a command as a line of the list: the name in 22 columns, then what it does. */
static void print_command(size_t i) {
    int width = printf("  %s %s", commands[i].name, commands[i].arguments);
    printf("%*s", 26 - width, "");
    for (const char *at = commands[i].about; *at; at++) {
        putchar(*at);
        if (*at == '\n')
            printf("%26s", "");
    }
    putchar('\n');
}

void help_print(const char *command) {
    unsigned blocks = 0;
    size_t count = sizeof commands / sizeof *commands;
    for (size_t i = 0; command && i < count; i++)
        if (strcmp(commands[i].name, command) == 0)
            blocks |= commands[i].blocks;
    bool is_one = blocks != 0;
    printf("Usage: splatctl COMMAND [OPTION]...\n\n%s:\n", is_one ? "Command" : "Commands");
    for (size_t i = 0; i < count; i++)
        if (!is_one || strcmp(commands[i].name, command) == 0)
            print_command(i);
    for (unsigned block = 0; block < BLOCKS; block++)
        if (!is_one || blocks & BIT(block))
            printf("%s%s", block == BLOCK_LOCAL ? "" : "\n", texts[block]);
    puts("\nExit status: 0 success, 1 failure, 2 usage.");
}
