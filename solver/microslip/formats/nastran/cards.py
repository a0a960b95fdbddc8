"""Effects of the cards of bulk data that are not taken over: text by name, and whether the effect changes the answer."""

# loads, dynamics, output, tables: stated in the scene
HARMLESS = set(
    "ENDDATA GRID GRDSET CORD1R CORD1C CORD1S CORD2R CORD2C CORD2S CTETRA CPENTA CHEXA CPYRAM PSOLID MAT1 MAT9 MAT11 SPC SPC1 "
    "SPOINT CONM2 RBE2 RBE3 CELAS1 CELAS2 PELAS MPC MPCADD PARAM PLOTEL SET1 SET3 EIGR EIGRL EIGC EIGB FORCE FORCE1 FORCE2 "
    "MOMENT MOMENT1 MOMENT2 PLOAD PLOAD1 PLOAD2 PLOAD4 LOAD GRAV ACCEL ACCEL1 RFORCE TEMP TEMPD TEMPRB TEMPP1 SLOAD DLOAD "
    "TLOAD1 TLOAD2 RLOAD1 RLOAD2 DAREA DELAY DPHASE TABLED1 TABLED2 TABLED3 TABLED4 TABDMP1 FREQ FREQ1 FREQ2 FREQ3 FREQ4 "
    "TSTEP TSTEPNL NLPARM RANDPS TABRND1 TF LSEQ DESVAR DVPREL1 DRESP1 DCONSTR DCONADD DOPTPRM DLINK SUPORT SUPORT1 ASET "
    "ASET1 QSET QSET1 BSET BSET1 CSET CSET1 OMIT OMIT1 USET USET1 PLOTEL3 PLOTEL4 ECHOON ECHOOFF PSET SPCADD "
    "CDAMP1 CDAMP2 PDAMP".split()
)
SHELLS = {"CQUAD4": "quad4", "CTRIA3": "tri3", "CQUAD8": "quad8", "CTRIA6": "tri6", "CQUADR": "quad4", "CTRIAR": "tri3"}
EFFECTS = {
    "MAT2": "an anisotropic material",
    "MAT8": "an orthotropic material",
    "MATS1": "a material that is not linear",
    "MATT1": "a material that depends on temperature",
    "CBAR": "a bar",
    "CBEAM": "a beam",
    "CROD": "a rod",
    "CONROD": "a rod",
    "CTUBE": "a tube",
    "CBUSH": "a bushing",
    "CGAP": "a gap element",
    "CVISC": "a damper",
    "CMASS1": "a scalar mass",
    "CMASS2": "a scalar mass",
    "CONM1": "a mass with a full matrix",
    "CSHEAR": "a shear panel",
    "CWELD": "a weld",
    "CFAST": "a fastener",
    "CBEND": "a curved beam",
    "DMIG": "a matrix at grid points",
    "RBAR": "a rigid bar",
    "RBE1": "a rigid element",
    "RROD": "a rigid rod",
    "BCTABLE": "contact",
    "BCTSET": "contact",
    "BCBODY": "a body in contact",
    "BSURF": "a surface in contact",
    "BSURFS": "a surface in contact",
    "BGSET": "glue",
    "BGADD": "glue",
    "BOLT": "a bolt; state [[statics.bolts]]",
    "SPCD": "an enforced displacement",
    "SPCOFF": "supports that are taken away",
    "CYJOIN": "cyclic symmetry",
    "CYAX": "cyclic symmetry",
}
PARTS = {"MAT2": "materials", "MAT8": "materials", "MATS1": "materials", "MATT1": "materials"}
