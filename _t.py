import time, numpy as np
from scipy.integrate import solve_ivp
from hoopd.physics.effects.catalogue import library
from hoopd.physics.declared import hoop_plant
from hoopd.physics.composite import Composite
from hoopd.physics.freerun import run
v=dict(mb=.0608,Ro=.0957,Rb=.0104,g=9.81,Ib=3.679e-6,Ih=1.518e-3,bb=2.6e-6,bh=7e-4)
ve=dict(mb=.0608,Ro=.0957,Rb=.0104,g=9.81,J11=-0.4818896328354544,J12=0.06769766279210704,K1=-5.119508012862879,L1=586.3694971455833,J21=-0.0032686776857956444,J22=-0.33509889971201284,K2=-73.63359905056758,L2=210.1200001949957)
t=np.arange(201)*.02; u=np.repeat([.1,-.1,.05,-.2,.1]*4,10)
for st,vv in (("rolling",v),("entries",ve),("published",v)):
    pl=hoop_plant(st,vv); lib=library(pl)
    c=Composite(pl,[lib["ball.slip"]]); b=Composite(pl,substeps=10)
    z0=run(c,{},[0,0,.2,0],t,u); zb=run(b,{},[0,0,.2,0],t,u); print(st,"neutral",(z0[:,:4]==zb).all(), abs(z0[:,5]).max())
    for mu in (.02,.05,.2):
        z=run(c,{"ball.slip.mu":mu},[0,0,.2,0],t,u)
        out=[mu,abs(z[:,5]).max(), (z[:,5]==0).mean()]
        for s in (20,40,80):
            zz=run(Composite(pl,[lib["ball.slip"]],s),{"ball.slip.mu":mu},[0,0,.2,0],t,u); out.append(abs(zz-z).max(0)[[0,2]])
        print(out)
