"""The script of the page: values under the pointer, zoom by dragging; the page is whole without it."""

SCRIPT = """
(function(){
function near(line,x){var p=line.points,a=0,b=p.numberOfItems-1;if(b<0)return null;
while(b-a>1){var m=(a+b)>>1;if(p.getItem(m).x<x)a=m;else b=m}
var u=p.getItem(a),v=p.getItem(b);return Math.abs(u.x-x)<Math.abs(v.x-x)?u:v}
function text(v){return Number(v.toPrecision(4)).toString()}
function setup(svg){if(svg.dataset.ready)return;svg.dataset.ready=1;
var full=svg.dataset.x.split(' ').map(Number),now=full.slice(),left=+svg.dataset.left,inner=+svg.dataset.inner,
fields=[].slice.call(svg.querySelectorAll('.field')),cursor=svg.querySelector('.cursor'),axis=svg.querySelector('.xaxis'),
shown=axis.innerHTML,tip=document.createElement('div'),from=null;
tip.className='tip';tip.hidden=true;svg.parentNode.style.position='relative';svg.parentNode.appendChild(tip);
function at(e){var r=svg.getBoundingClientRect(),w=svg.viewBox.baseVal.width;return((e.clientX-r.left)/r.width*w-left)/inner}
function zoom(a,b){now=[a,b];var s=inner/(full[1]-full[0]),p=(a-full[0])*s,w=(b-a)*s;
fields.forEach(function(f){var v=f.getAttribute('viewBox').split(' ');v[0]=p;v[2]=w;f.setAttribute('viewBox',v.join(' '))});
if(a===full[0]&&b===full[1]){axis.innerHTML=shown;return}
var t=axis.children,n=t.length;for(var i=0;i<n;i++){var q=n>1?i/(n-1):0.5;t[i].setAttribute('x',left+inner*q);
t[i].textContent=text(a+(b-a)*q)}}
function hide(){cursor.setAttribute('visibility','hidden');tip.hidden=true}
svg.addEventListener('pointermove',function(e){var q=at(e);if(q<0||q>1){hide();return}
var x=now[0]+q*(now[1]-now[0]),px=(x-full[0])/(full[1]-full[0])*inner,rows=[text(x)];
fields.forEach(function(f){var y=f.dataset.y.split(' ').map(Number),h=+f.getAttribute('height');
[].forEach.call(f.querySelectorAll('polyline[data-name]'),function(l){var b=l.points;
if(!b.numberOfItems||px<b.getItem(0).x-2||px>b.getItem(b.numberOfItems-1).x+2)return;var u=near(l,px);
rows.push(l.dataset.name+'  '+text(y[0]+(1-u.y/h)*(y[1]-y[0])))})});
cursor.setAttribute('transform','translate('+(left+inner*q)+' 0)');cursor.setAttribute('visibility','visible');
tip.textContent=rows.join('\\n');tip.hidden=false;var r=svg.parentNode.getBoundingClientRect(),w=tip.offsetWidth,
c=e.clientX-r.left;tip.style.left=(c+w+24>r.width?Math.max(0,c-w-12):c+12)+'px';tip.style.top=(e.clientY-r.top+12)+'px'});
svg.addEventListener('pointerleave',hide);
svg.addEventListener('pointerdown',function(e){if(e.pointerType!=='touch')from=at(e)});
svg.addEventListener('pointerup',function(e){if(from===null)return;var q=[from,at(e)].sort(function(a,b){return a-b});from=null;
q=[Math.max(0,q[0]),Math.min(1,q[1])];if(q[1]-q[0]>0.02)zoom(now[0]+q[0]*(now[1]-now[0]),now[0]+q[1]*(now[1]-now[0]))});
svg.addEventListener('dblclick',function(){zoom(full[0],full[1])})}
[].forEach.call(document.querySelectorAll('.skgap svg.plot'),setup)})();
"""
