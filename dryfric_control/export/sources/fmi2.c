/* FMI 2.0 Co-Simulation round the model in model.c. */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "model.c"

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter" /* the interface says which there are */
#endif

typedef struct {
    model_t model;
    const fmi2CallbackFunctions *functions;
    char name[128];
} instance_t;

static fmi2Status failed(const instance_t *instance, const char *why)
{
    if (instance != NULL && instance->functions != NULL && instance->functions->logger != NULL) {
        instance->functions->logger(instance->functions->componentEnvironment, instance->name,
                                    fmi2Error, "logStatusError", "%s", why);
    }
    return fmi2Error;
}

#define FMI(name) fmi2##name
#define HANDLE fmi2Component
#define STATE(verb, rest) fmi2##verb##FMUstate##rest
#define UNPACK fmi2DeSerializeFMUstate
#include "fmi.c"

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    instance_t *instance;
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, MODEL_TOKEN) != 0) {
        return NULL;
    }
    instance = calloc(1, sizeof *instance);
    if (instance != NULL) {
        instance->functions = functions;
        if (name != NULL) {
            strncpy(instance->name, name, sizeof instance->name - 1);
        }
        model_reset(&instance->model);
    }
    return instance;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean ends, fmi2Real stop)
{
    ((instance_t *)c)->model.start = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    return told(c, model_read(MODEL(c), vr, n, value));
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    return told(c, model_count(MODEL(c), vr, n, value));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    return told(c, model_write(MODEL(c), vr, n, value));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final)
{
    return told(c, model_step(MODEL(c), time, step));
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    *value = fmi2OK;
    return fmi2OK;
}

/* What a model of this kind does not have. */
#define NO_ACCESS(Kind) \
    fmi2Status fmi2Get##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Kind value[]) \
    { return n == 0 ? fmi2OK : failed(c, "no variable of that type"); } \
    fmi2Status fmi2Set##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Kind value[]) \
    { return n == 0 ? fmi2OK : failed(c, "no variable of that type"); }

NO_ACCESS(Boolean)
NO_ACCESS(String)

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    return n == 0 ? fmi2OK : failed(c, "no integer can be set");
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return failed(c, "a step ends before it can be cancelled");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t nu,
                                        const fmi2ValueReference known[], size_t nk, const fmi2Real seed[],
                                        fmi2Real result[])
{
    return failed(c, "no derivatives");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    return failed(c, "inputs are held");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    return failed(c, "no derivatives");
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    *value = ((instance_t *)c)->model.time;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    *value = fmi2False;
    return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    return fmi2Discard;
}
