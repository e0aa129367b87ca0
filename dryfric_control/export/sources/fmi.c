/* What FMI 2.0 and 3.0 have in common.  The file that includes it defines `instance_t`, whose
   first member is the model, `failed`, HANDLE, FMI(name), STATE(verb, rest) and UNPACK. */

#define MODEL(c) (&((instance_t *)(c))->model)

static FMI(Status) told(const instance_t *instance, const char *why)
{
    return why == NULL ? FMI(OK) : failed(instance, why);
}

const char *FMI(GetVersion)(void)
{
    return FMI(Version);
}

FMI(Status) FMI(SetDebugLogging)(HANDLE c, FMI(Boolean) on, size_t n, const FMI(String) categories[])
{
    return FMI(OK);
}

void FMI(FreeInstance)(HANDLE c)
{
    free(c);
}

FMI(Status) FMI(ExitInitializationMode)(HANDLE c)
{
    model_start(MODEL(c));
    return FMI(OK);
}

FMI(Status) FMI(Terminate)(HANDLE c)
{
    return FMI(OK);
}

FMI(Status) FMI(Reset)(HANDLE c)
{
    model_reset(MODEL(c));
    return FMI(OK);
}

FMI(Status) STATE(Get, )(HANDLE c, STATE(, ) *state)
{
    return told(c, model_keep(state, MODEL(c)));
}

FMI(Status) STATE(Set, )(HANDLE c, STATE(, ) state)
{
    memcpy(MODEL(c), state, sizeof(model_t));
    return FMI(OK);
}

FMI(Status) STATE(Free, )(HANDLE c, STATE(, ) *state)
{
    free(*state);
    *state = NULL;
    return FMI(OK);
}

FMI(Status) STATE(Serialized, Size)(HANDLE c, STATE(, ) state, size_t *size)
{
    *size = sizeof(model_t);
    return FMI(OK);
}

FMI(Status) STATE(Serialize, )(HANDLE c, STATE(, ) state, FMI(Byte) bytes[], size_t size)
{
    return told(c, model_pack(state, bytes, size));
}

FMI(Status) UNPACK(HANDLE c, const FMI(Byte) bytes[], size_t size, STATE(, ) *state)
{
    return told(c, model_unpack(state, bytes, size));
}
